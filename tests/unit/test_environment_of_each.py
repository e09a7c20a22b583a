"""No test leaves its environment to the next one."""

import os


def test_one_sets_what_a_dask_cluster_sets() -> None:
    os.environ["PYTHONHASHSEED"] = "6640"


def test_the_next_one_does_not_have_it() -> None:
    assert os.environ.get("PYTHONHASHSEED") != "6640"
