"""``python -m bridge.autopilots.standin``."""

from bridge.autopilots.standin.cli import main

raise SystemExit(main())
