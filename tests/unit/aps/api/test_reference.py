"""The reference of the API in docs is the code's."""

from pathlib import Path

from aps.api.reference import FILE, current
from aps.vehicle.commander import VERBS, argument_names

ROOT = Path(__file__).parents[4]


def test_the_reference_in_docs_is_made_from_this_code():
    assert (ROOT / FILE).read_text(encoding="utf-8") == current(), "stale: run make api-docs"


def test_every_command_is_there_with_all_its_arguments_and_what_they_mean():
    text = current()
    for verb in VERBS:
        section = text.split(f"### POST /commands/{verb}\n", 1)[1].split("###", 1)[0]
        rows = [line.split("|") for line in section.splitlines() if line.startswith("| `")]
        assert [row[1].strip(" `") for row in rows] == list(argument_names(verb))
        assert all(row[4].strip() for row in rows), verb
