"""What a router is opened with so that it asks for passwords and keeps to the table of rights."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from bridge.bus.identity.keyring import Keyring
from bridge.bus.identity.rules import access_control


@dataclass(frozen=True, slots=True)
class RouterGuard:
    """Whom the router of a run lets in, and what they may do.

    Attributes:
        run: its name, in all of its keys.
        keyring: its passwords.
    """

    run: str
    keyring: Keyring

    @property
    def settings(self) -> tuple[tuple[str, Any], ...]:
        """For the configuration of Zenoh's router.

        Raises:
            OSError, ValueError: the keyring is not there or not ours.
        """
        return (
            ("transport/auth/usrpwd/dictionary_file", str(self.keyring.dictionary)),
            ("access_control", access_control(self.run, self.keyring.identities)),
        )
