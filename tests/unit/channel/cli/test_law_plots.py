from channel.cli.law_plots import PLOTS, write_law_plots


def test_one_picture_per_group_of_laws(tmp_path):
    files = write_law_plots(tmp_path / "laws")
    assert [file.name for file in files] == [f"{name}.png" for name in PLOTS]
    assert all(file.read_bytes().startswith(b"\x89PNG") for file in files)
