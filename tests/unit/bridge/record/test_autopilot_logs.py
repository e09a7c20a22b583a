from pathlib import Path

from bridge.record.autopilot_logs import autopilot_logs


def test_logs_of_both_autopilots_are_found_by_node(tmp_path: Path) -> None:
    kept = ("autopilot-0/log/2023-11-14/22_13_20.ulg", "autopilot-12/logs/00000001.BIN")
    for name in (*kept, "autopilot-12/logs/LASTLOG.TXT", "autopilot-2/eeprom.bin", "logs/autopilot-0.log"):
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(b"")
    assert autopilot_logs(tmp_path) == {"0": [kept[0]], "12": [kept[1]]}


def test_a_run_of_stand_ins_has_none(tmp_path: Path) -> None:
    assert autopilot_logs(tmp_path) == {}
