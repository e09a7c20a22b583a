"""The mission's modules are found beside its agent, as in a run."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[4] / "examples" / "relay_placement"))
