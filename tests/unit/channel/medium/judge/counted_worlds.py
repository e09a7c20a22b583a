"""How often the verdict fails right and wrong worlds: `python -m tests.unit.channel.medium.judge.counted_worlds 100`.

A line for each of `worlds`: how many of so many failed; of wrong ones by the check that should see what is wrong, with
the power that the check states of itself (median over the worlds). `right` or `wrong` after the number: these alone.
"""

import statistics
import sys

from tests.unit.channel.medium.judge.worlds import RIGHT, WRONG, failures, verdicts


def right_line(name: str, repeats: int) -> str:
    """A right world: how many failed, and by what."""
    judged = verdicts(RIGHT[name], repeats)
    failed = failures(judged)
    names = sorted({check.name for checks in failed.values() for check in checks})
    least = min(check.chance for verdict in judged for check in verdict.checks)
    return f"right  {name:<45}{len(failed):>4} failed  {', '.join(names)}; least chance {least:.1e}"


def wrong_line(name: str, repeats: int) -> str:
    """A wrong world: how many failed, and how many by the check that it is for."""
    judged, wanted = verdicts(WRONG[name], repeats), WRONG[name][3]
    failed = failures(judged)
    seen = sum(wanted in [check.name for check in checks] for checks in failed.values())
    powers = [check.power for verdict in judged for check in verdict.checks if check.name == wanted]
    by = f"{seen} by {wanted}, whose power is {statistics.median(powers):.3f}"
    return f"wrong  {name:<45}{len(failed):>4} failed, {by}"


def main(repeats: int, kinds: list[str]) -> None:
    """Print the table, of right worlds, wrong ones or both."""
    lines = {"right": (RIGHT, right_line), "wrong": (WRONG, wrong_line)}
    for worlds, line in (lines[kind] for kind in kinds or lines):
        for name in worlds:
            print(line(name, repeats), flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2:])
