import subprocess
import sys

from bridge.run.garbage import THRESHOLD

COMMAND = """
import atexit, gc, sys
atexit.register(lambda: print(gc.get_threshold()[0], gc.get_freeze_count() > 1000))
sys.argv = ["lostlink", "--version"]
from lostlink.cli.entry import main
main()
"""


def test_the_command_looks_for_garbage_rarely_and_at_its_end_for_none() -> None:
    said = subprocess.run([sys.executable, "-c", COMMAND], capture_output=True, text=True, check=True).stdout
    assert said.splitlines()[-1] == f"{THRESHOLD} True"
