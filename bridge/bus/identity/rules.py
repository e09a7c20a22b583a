"""The table of rights as the configuration of Zenoh's access control.

Zenoh filters messages between the router and each client, by type, direction (ingress: from the client) and key. So
every right takes two or more rules: to read is to declare a subscription (ingress) and to be sent samples (egress).

A client that declares a publisher or a querier sends nothing unless it knows of a listener, with the
listener's own key expression: so everybody may learn of all subscriptions, and who asks of all queryables. They say
which keys exist, not what is on them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final

from bridge.bus.identity.roster import Identity
from bridge.bus.identity.table import (
    HOST,
    LOOKERS,
    OBSERVER,
    OWN,
    PHYSICS,
    SCOPES,
    TABLE,
    AccessRole,
    AccessRow,
)
from bridge.bus.keys import ROOT, Keys

LOOPBACK: Final = ("lo", "lo0")
"""Names of the loopback interface, on Linux and on macOS and BSD."""
INGRESS, EGRESS = ("ingress",), ("egress",)
EVERYTHING: Final = ("**",)
"""All keys but those of Zenoh's own (``@/...``), which ``**`` does not match."""

Rule = dict[str, Any]


def access_control(run: str, identities: Sequence[Identity]) -> dict[str, Any]:
    """Zenoh's ``access_control`` for a run: default deny, and a policy per identity.

    The number of rules grows with that of the identities, and that of keys with that of the nodes: never with pairs.
    """
    rules, policies = [], []
    for identity in identities:
        own = list(rules_of(run, identity))
        rules += own
        policies.append({"rules": [rule["id"] for rule in own], "subjects": [identity.name]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [_subject(identity) for identity in identities],
        "policies": policies,
    }


def rules_of(run: str, identity: Identity) -> Iterable[Rule]:
    """The rules of one identity."""

    def keys_of(right: Callable[[AccessRow], AccessRole]) -> list[str]:
        return [key for row in TABLE if identity.role in right(row) for key in _keys(run, identity, row.key)]

    asked, served = keys_of(lambda row: row.asks), keys_of(lambda row: row.serves)
    looked_at = [row.key for row in TABLE if identity.role in row.serves and OBSERVER in row.asks]
    # Whoever looks may ask all nodes at once, which is more than what a host serves; it is asked for its own.
    of_all_nodes = [f"{Keys(run).prefix}/{key.format(node='*')}" for key in looked_at]
    wanted = (
        ("write", INGRESS, ("put",), keys_of(lambda row: row.writes)),
        ("listen", INGRESS, ("declare_subscriber",), _scope(run, identity)),
        ("read", EGRESS, ("put",), keys_of(lambda row: row.reads)),
        ("learn", EGRESS, ("declare_subscriber",), EVERYTHING),
        ("ask", INGRESS, ("query",), asked),
        ("hear", EGRESS, ("reply", "declare_queryable"), asked),
        ("serve", INGRESS, ("declare_queryable", "reply"), served),
        ("be-asked", EGRESS, ("query",), [*served, *of_all_nodes]),
        ("hold", INGRESS, ("liveliness_token",), keys_of(lambda row: row.holds)),
        ("watch", INGRESS, ("liveliness_query", "declare_liveliness_subscriber"), _watched(identity)),
        ("see", EGRESS, ("liveliness_token",), _watched(identity)),
    )
    for what, flows, messages, keys in wanted:
        if keys:
            yield {
                "id": f"{identity.name}-{what}",
                "permission": "allow",
                "flows": list(flows),
                "messages": list(messages),
                "key_exprs": list(keys),
            }


def _subject(identity: Identity) -> dict[str, Any]:
    subject: dict[str, Any] = {"id": identity.name, "usernames": [identity.name]}
    # The observer's password is no secret, so it is good on this machine only.
    return subject | ({"interfaces": list(LOOPBACK)} if identity.role is OBSERVER else {})


def _keys(run: str, identity: Identity, template: str) -> list[str]:
    name = identity.name if identity.role in HOST | PHYSICS else "*"
    host = identity.name if identity.role is HOST else "*"
    nodes = identity.nodes if identity.role in OWN else ("*",)
    if "{node}" not in template:
        nodes = nodes[:1]
    return [f"{Keys(run).prefix}/{template.format(node=node, self=name, host=host)}" for node in nodes]


def _scope(run: str, identity: Identity) -> Sequence[str]:
    if identity.role in LOOKERS:
        return EVERYTHING
    return [key for template in SCOPES[identity.role] for key in _keys(run, identity, template)]


def _watched(identity: Identity) -> Sequence[str]:
    """Whoever watches may do so without knowing the name of the run; this router has one only."""
    templates = [row.key for row in TABLE if identity.role in row.watches]
    return [f"{ROOT}/*/{template.format(node='*', self='*', host='*')}" for template in templates]
