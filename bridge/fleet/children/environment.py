"""The environment of a run's processes: what makes them compute and order things alike on every machine."""

from __future__ import annotations

from collections.abc import Mapping

from bridge.run.px4 import HOME_VARIABLE

HWCAPS = "glibc.cpu.hwcaps"
NO_FUSED_MATHS = ",".join(
    f"-{name}{usable}" for name in ("AVX2", "FMA", "FMA4", "AVX", "AVX512F") for usable in ("", "_Usable")
)
"""The C library's sin, exp, pow and others differ in their last bits between CPUs with and without fused multiply-add;
flights part from there within seconds. Without these features they are the plain ones, which every x86-64 CPU has. (The
names that end in _Usable are those of C libraries before 2.33; a library passes over names that it does not know.)"""

OF_PX4 = frozenset({"replay", "replay_mode", "ROS_DOMAIN_ID", "RUN_MINIMAL_SHELL"})
"""What PX4 and its start script take from the environment besides ``PX4_*``."""


def environment_of(ours: Mapping[str, str]) -> dict[str, str]:
    """The environment of our own processes and of the autopilots, from that of the supervisor.

    - ``PYTHONHASHSEED``: sets of texts have one order in every run.
    - ``OPENBLAS_NUM_THREADS``: no sum depends on the number of cores.
    - ``GLIBC_TUNABLES``: no number depends on the CPU's vector instructions; what else it tunes is kept.
    - ``PX4_*`` and the like are left out: another host for the simulation, another model, other timeouts. PX4_HOME
      is ours: runs of a study look for PX4 there.
    """
    kept = {name: value for name, value in ours.items() if name == HOME_VARIABLE or not _is_of_px4(name)}
    return {**kept, **of_runs(ours)}


def _is_of_px4(name: str) -> bool:
    return name.startswith("PX4_") or name in OF_PX4


def has_environment(ours: Mapping[str, str]) -> bool:
    """Whether a process that was started with ``ours`` computes and orders things as a run's processes do."""
    return all(ours.get(name) == value for name, value in of_runs(ours).items())


def of_runs(ours: Mapping[str, str]) -> dict[str, str]:
    """The variables that make a process one of a run's, from those of whoever starts it."""
    return {
        "PYTHONHASHSEED": "0",
        "OPENBLAS_NUM_THREADS": "1",
        "GLIBC_TUNABLES": _tunables(ours.get("GLIBC_TUNABLES", "")),
    }


def _tunables(given: str) -> str:
    kept = [item for item in given.split(":") if item and not item.startswith(f"{HWCAPS}=")]
    return ":".join([*kept, f"{HWCAPS}={NO_FUSED_MATHS}"])
