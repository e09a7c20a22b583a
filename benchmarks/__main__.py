"""Runs every benchmark: `python -m benchmarks [NAME ...]`, such as `python -m benchmarks fdm router`."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

HERE = Path(__file__).parent
MODULES = {
    path.stem.removeprefix("bench_"): ".".join(("benchmarks", *path.relative_to(HERE).with_suffix("").parts))
    for path in sorted(HERE.rglob("bench_*.py"), key=lambda path: path.name)
}


def main(names: list[str]) -> int:
    """Run the named benchmarks, or all."""
    unknown = sorted(set(names) - set(MODULES))
    if unknown:
        print(f"no benchmark {', '.join(unknown)}; there are: {', '.join(MODULES)}", file=sys.stderr)
        return 2
    for name in names or MODULES:
        print(f"== {name}", flush=True)
        import_module(MODULES[name]).main([])
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
