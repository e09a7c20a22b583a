"""What an agent or a script can have its aircraft do: a coroutine per command, and errors that say how one failed.

Each returns when it is done. Points and velocities to fly to (`goto`, `goto_ned`, `velocity`, `follow`, `orbit`) give
way to a newer one of them: the older then returns False, which is no failure. Any other flight command interrupts them.
"""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from bridge.agents.frames import Frames
from bridge.bus.messages import CommandEvent, CommandGoal

OnFeedback = Callable[[CommandEvent], object]


class CommandFailed(RuntimeError):
    """The aircraft refused a command or could not carry it out; the text says why."""


class CommandRefused(CommandFailed):
    """The autopilot, or the daemon before it, said no."""


class CommandTimedOut(CommandFailed):
    """No answer, or not there in the time allowed."""


class CommandInterrupted(CommandFailed):
    """Another command took over, the mode was changed, the UA was disarmed, or the autopilot rebooted."""


class RunOver(CommandFailed):
    """The run is over: nobody carries out a command any more, and no newer state comes."""


_FAILURES = {
    "refused": CommandRefused,
    "timed_out": CommandTimedOut,
    "interrupted": CommandInterrupted,
}


def failure(outcome: str, text: str) -> CommandFailed:
    """The error for an outcome of a command."""
    return _FAILURES.get(outcome, CommandFailed)(text)


def _as_json(arguments: Mapping[str, Any]) -> str:
    """Those of the arguments that are given; nothing is escaped, so that what is no text is seen."""
    given = {name: value for name, value in arguments.items() if value is not None}
    return json.dumps(given, ensure_ascii=False, default=plain) if given else ""


def plain(value: object) -> object:
    """A scalar or an array of numpy as Python's own, for JSON.

    Raises:
        TypeError: it is neither.
    """
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{value!r} is of type {type(value).__name__}, which JSON has not")


def checked_numbers(verb: str, **arguments: object) -> dict[str, float]:
    """Arguments that have to be numbers, Python's or numpy's; as Python's.

    Raises:
        TypeError: one is none.
        ValueError: one is more than a float can hold.
    """
    found = {}
    for name, value in arguments.items():
        number = value.item() if isinstance(value, np.generic) else value
        if isinstance(number, bool) or not isinstance(number, int | float):
            raise TypeError(f"{verb}: {name} has to be a number, and is {value!r}")
        try:
            found[name] = float(number)
        except OverflowError as error:
            raise ValueError(f"{verb}: {name} is more than a number can be: {value!r:.40}...") from error
    return found


LOCAL_FRAMES = ("fleet", "origin", "offset", "body")
"""Of `Commands.goto_ned`."""


class Commands(ABC):
    """The commands of a node's aircraft. Arguments that are not given are left to the autopilot."""

    frames: Frames | None = None
    """The node's and the fleet's frame, if they are known."""

    @abstractmethod
    async def command(
        self, verb: str, goal: CommandGoal | None = None, on_feedback: OnFeedback | None = None
    ) -> CommandEvent:
        """Have the aircraft carry out ``verb``; returns the result once it is there.

        Raises:
            CommandFailed: it was refused, timed out or interrupted.
        """

    async def run(self, verb: str, on_feedback: OnFeedback | None = None, **arguments: Any) -> CommandEvent:
        """Any command by its name and its arguments' names; docs/reference/aps.md lists them.

        Raises:
            CommandFailed: it was refused, timed out or interrupted.
            TypeError: an argument is nothing that JSON knows.
            ValueError: a text in them is none that UTF-8 has.
        """
        return await self.command(verb, CommandGoal(arguments=_as_json(arguments)), on_feedback)

    async def _target(self, verb: str, on_feedback: OnFeedback | None, **arguments: Any) -> bool:
        return (await self.run(verb, on_feedback, **arguments)).outcome != "superseded"

    # --- the aircraft

    async def arm(self) -> None:
        """Arm the motors."""
        await self.command("arm")

    async def disarm(self, *, force: bool = False) -> None:
        """Disarm the motors; in flight only by force."""
        await self.run("disarm", force=force or None)

    async def set_mode(self, mode: str) -> None:
        """Change the flight mode, by the autopilot's own name."""
        await self.command("mode", CommandGoal(mode=mode))

    async def takeoff(self, alt_rel_m: float) -> None:
        """Take off and climb to ``alt_rel_m`` above home."""
        height = checked_numbers("takeoff", alt_rel_m=alt_rel_m)
        await self.command("takeoff", CommandGoal(altitude_rel_m=height["alt_rel_m"]))

    async def rtl(self) -> None:
        """Return to launch and land."""
        await self.command("rtl")

    async def land(self) -> None:
        """Land here."""
        await self.command("land")

    async def change_speed(self, speed_mps: float, kind: str | None = None) -> None:
        """Change the speed, not the goal; ``kind`` is ``air``, ``ground``, ``climb`` or ``descent``."""
        wanted: dict[str, Any] = {**checked_numbers("change_speed", speed_mps=speed_mps), "kind": kind}
        await self.run("speed", **wanted)

    async def reboot(self) -> None:
        """Have the autopilot boot anew; refused while it is armed. A run in which it does may not repeat."""
        await self.run("reboot")

    # --- where to fly to

    async def hold(self) -> bool:
        """Stop and stay here, whatever it flew before; a plane circles. Returns as `goto`, once it stands still."""
        return await self._target("hold", None)

    async def goto(
        self,
        lat_deg: float,
        lon_deg: float,
        alt_rel_m: float,
        *,
        speed_mps: float = 0.0,
        yaw_deg: float | None = None,
        frame: str | None = None,
        within_m: float | None = None,
        on_feedback: OnFeedback | None = None,
    ) -> bool:
        """Fly to a point; returns True when it is reached, False when a newer target took its place.

        Args:
            lat_deg: of the point.
            lon_deg: of the point.
            alt_rel_m: above home, unless ``frame`` says otherwise.
            speed_mps: 0: as the autopilot is set.
            yaw_deg: heading of the nose.
            frame: ``relative`` (home), ``amsl`` (mean sea level) or ``terrain`` (the ground below).
            within_m: how near to the point, over ground, counts as there: 2, of a plane 200, unless given.
            on_feedback: called with the way to go.
        """
        more = _as_json({"yaw_deg": yaw_deg, "frame": frame, "within_m": within_m})
        at = checked_numbers(
            "goto", lat_deg=lat_deg, lon_deg=lon_deg, alt_rel_m=alt_rel_m, speed_mps=speed_mps
        )
        goal = CommandGoal("", at["lon_deg"], at["lat_deg"], at["alt_rel_m"], at["speed_mps"], more)
        return (await self.command("goto", goal, on_feedback)).outcome != "superseded"

    async def goto_ned(
        self,
        north_m: float,
        east_m: float,
        down_m: float,
        *,
        frame: str = "origin",
        speed_mps: float = 0.0,
        yaw_deg: float | None = None,
        within_m: float | None = None,
        on_feedback: OnFeedback | None = None,
    ) -> bool:
        """Fly to a point in metres; returns as `goto`.

        Args:
            north_m: north of the point; ``body``: ahead.
            east_m: east of the point; ``body``: to the right.
            down_m: down of the point.
            frame: ``fleet`` (the scenario's origin, as of all nodes), ``origin`` (the autopilot's local origin: its
                home), ``offset`` (from here) or ``body`` (from here, along the heading).
            speed_mps: over ground; 0: as the autopilot is set.
            yaw_deg: heading of the nose.
            within_m: how near to the point counts as there; 2 unless given.
            on_feedback: called with the way to go.

        Raises:
            TypeError: ``north_m``, ``east_m`` or ``down_m`` is no number.
            ValueError: there is no such frame; or it is ``fleet``, and the run's frames are not known here.
        """
        if frame not in LOCAL_FRAMES:
            raise ValueError(f"goto_ned: frame {frame!r} is none of {', '.join(LOCAL_FRAMES)}")
        place = checked_numbers("goto_ned", north_m=north_m, east_m=east_m, down_m=down_m)
        speed = checked_numbers("goto_ned", speed_mps=speed_mps) if speed_mps else {}
        if frame == "fleet":
            if self.frames is None:
                raise ValueError("goto_ned(frame='fleet'): where the fleet's frame begins is not known here")
            own = self.frames.own_from_fleet((place["north_m"], place["east_m"], place["down_m"]))
            frame, place = "origin", dict(zip(place, own, strict=True))
        how = {"frame": frame, "yaw_deg": yaw_deg, "within_m": within_m}
        return await self._target("goto_ned", on_feedback, **place, **speed, **how)

    async def velocity(
        self,
        north_mps: float,
        east_mps: float,
        down_mps: float = 0.0,
        *,
        yaw_deg: float | None = None,
        yaw_rate_dps: float | None = None,
        frame: str = "ned",
        duration_s: float = 3.0,
        rate_hz: float = 5.0,
    ) -> bool:
        """Fly at a velocity for ``duration_s`` of the autopilot's time, then stop; returns as `goto`.

        To steer at every tick do not wait for it: ``asyncio.create_task(ua.velocity(...))``; each newer one takes over.

        Args:
            north_mps: over ground to the north; ``body``: ahead.
            east_mps: to the east; ``body``: to the right.
            down_mps: down; negative climbs.
            yaw_deg: heading of the nose.
            yaw_rate_dps: rate of turn, instead of a heading.
            frame: ``ned`` or ``body``.
            duration_s: how long to keep it up without a newer one.
            rate_hz: how often the setpoint is repeated.
        """
        wanted = checked_numbers("velocity", north_mps=north_mps, east_mps=east_mps, down_mps=down_mps)
        nose = {"yaw_deg": yaw_deg, "yaw_rate_dps": yaw_rate_dps}
        how = {"frame": frame, "duration_s": duration_s, "rate_hz": rate_hz}
        return await self._target("velocity", None, **wanted, **nose, **how)

    async def follow(
        self,
        lat_deg: float,
        lon_deg: float,
        alt_rel_m: float,
        *,
        velocity_ned_mps: tuple[float, float, float] = (0.0, 0.0, 0.0),
        yaw_deg: float | None = None,
        duration_s: float = 3.0,
        rate_hz: float = 5.0,
    ) -> bool:
        """Fly with a target that is here now and moves at ``velocity_ned_mps``; call again with newer.

        Returns as `goto`.
        """
        north, east, down = velocity_ned_mps
        place = checked_numbers("follow", lat_deg=lat_deg, lon_deg=lon_deg, alt_rel_m=alt_rel_m)
        speeds = checked_numbers("follow", north_mps=north, east_mps=east, down_mps=down)
        how = {"yaw_deg": yaw_deg, "duration_s": duration_s, "rate_hz": rate_hz}
        return await self._target("follow", None, **place, **speeds, **how)

    async def orbit(
        self,
        lat_deg: float,
        lon_deg: float,
        alt_rel_m: float,
        radius_m: float,
        *,
        speed_mps: float = 5.0,
        turns: float = 1.0,
        clockwise: bool = True,
        on_feedback: OnFeedback | None = None,
    ) -> bool:
        """Circle a point ``turns`` times; returns as `goto`."""
        place = checked_numbers(
            "orbit", lat_deg=lat_deg, lon_deg=lon_deg, alt_rel_m=alt_rel_m, radius_m=radius_m
        )
        how = {"speed_mps": speed_mps, "turns": turns, "clockwise": clockwise}
        return await self._target("orbit", on_feedback, **place, **how)

    # --- missions, parameters, messages

    async def mission(
        self,
        items: Iterable[Mapping[str, Any]],
        *,
        on_feedback: OnFeedback | None = None,
    ) -> None:
        """Upload a mission, and fly it from its first item to its end; the UA has to be armed.

        Args:
            items: without home; each ``{"command": 16, "params": [7 numbers], "frame": 3}``, see docs/reference/aps.md.
            on_feedback: called with the item that it is at.
        """
        await self.missions.upload(items)
        # ArduPilot would go on at the number where a mission before was stopped.
        await self.missions.fly(0, on_feedback=on_feedback)

    @property
    def missions(self) -> Missions:
        """Missions, fences and rally points of the autopilot."""
        return Missions(self)

    @property
    def parameters(self) -> Parameters:
        """The autopilot's parameters."""
        return Parameters(self)

    async def message(self, name: str) -> dict[str, Any]:
        """A MAVLink message of the autopilot as it is now, such as ``WIND``: its fields; None where one is NaN."""
        fields: dict[str, Any] = json.loads((await self.run("message", name=name)).value)
        return fields

    async def send(self, name: str, /, **fields: Any) -> None:
        """Send a MAVLink message to the autopilot; nothing is waited for."""
        await self.run("send", name=name, fields=fields)


class Missions:
    """Missions, fences and rally points; ``kind`` is ``mission``, ``fence`` or ``rally``. Home is no item."""

    def __init__(self, ua: Commands) -> None:
        self._ua = ua

    async def upload(self, items: Iterable[Mapping[str, Any]], kind: str = "mission") -> int:
        """Give the autopilot a list in place of what it has; returns how many items it took."""
        event = await self._ua.run("mission_upload", items=list(items), kind=kind)
        return int(json.loads(event.value))

    async def download(self, kind: str = "mission") -> list[dict[str, Any]]:
        """The items that the autopilot has."""
        items: list[dict[str, Any]] = json.loads((await self._ua.run("mission_download", kind=kind)).value)
        return items

    async def clear(self, kind: str = "mission") -> None:
        """Have the autopilot forget its list."""
        await self._ua.run("mission_clear", kind=kind)

    async def set_current(self, seq: int) -> None:
        """Go on with another item, as the autopilot counts: ArduPilot's first after home is 1."""
        await self._ua.run("mission_set_current", seq=seq)

    async def fly(self, first: int | None = None, *, on_feedback: OnFeedback | None = None) -> None:
        """Fly the mission that the autopilot has, from item ``first`` on, to its end."""
        await self._ua.run("mission", on_feedback, first=first)


class Parameters:
    """The autopilot's parameters."""

    def __init__(self, ua: Commands) -> None:
        self._ua = ua

    async def get(self, name: str) -> float:
        """Read one."""
        return float(json.loads((await self._ua.run("parameter_get", name=name)).value))

    async def set(self, name: str, value: float) -> None:
        """Set one; returns when the autopilot reports the new value."""
        await self._ua.run("parameter_set", name=name, value=value)

    async def all(self, on_feedback: OnFeedback | None = None) -> dict[str, float]:
        """Read all; takes the autopilot some seconds, in a run up to a minute of sim time."""
        values: dict[str, float] = json.loads((await self._ua.run("parameters", on_feedback)).value)
        return values
