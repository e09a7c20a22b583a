"""``python -m bridge.standin``."""

from bridge.standin.cli import main

raise SystemExit(main())
