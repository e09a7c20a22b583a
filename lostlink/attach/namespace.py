"""Makes a network namespace with one interface, and becomes a program in it: ``namespace.py SETTINGS PROGRAM ARG...``.

SETTINGS is a JSON object, see `InterfaceSettings`. Whoever starts it gets the other side of the interface (a TUN
device: whole IP packets) through the socket of `InterfaceSettings.fd`, and answers with a byte when the program may
start; the message with the device is a remark, empty if all went well, and a message without one says why it could not
be made.
"""

from __future__ import annotations

import ctypes
import fcntl
import json
import os
import signal
import socket
import struct
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple, NoReturn

CLONE_NEWNS, CLONE_NEWUSER, CLONE_NEWNET = 0x00020000, 0x10000000, 0x40000000
MS_BIND, MS_REC, MS_PRIVATE, MNT_DETACH = 0x1000, 0x4000, 0x40000, 2
PR_SET_PDEATHSIG: Final = 1
TUN: Final = "/dev/net/tun"
TUNSETIFF, IFF_TUN, IFF_NO_PI = 0x400454CA, 0x0001, 0x1000
SIOCGIFFLAGS, SIOCSIFFLAGS, IFF_UP = 0x8913, 0x8914, 0x1
SIOCSIFADDR, SIOCSIFNETMASK, SIOCSIFMTU, SIOCADDRT = 0x8916, 0x891C, 0x8922, 0x890B
RTF_UP: Final = 0x1
MULTICAST, LIMITED_BROADCAST = ("224.0.0.0", "240.0.0.0"), ("255.255.255.255", "255.255.255.255")
"""Address and mask of what is for all nodes."""
HOSTS: Final = "/etc/hosts"
CANNOT_START, NOT_FOUND = 126, 127
"""Exit codes of shells, for programs that cannot be run and that are not there."""


class InterfaceSettings(NamedTuple):
    """What the namespace is to have.

    Attributes:
        fd: of the socket to whoever started this.
        parent: process id of that one.
        interface: name of the interface.
        address, netmask: of it.
        mtu_bytes: of it.
        hosts: lines for /etc/hosts.
    """

    fd: int
    parent: int
    interface: str
    address: str
    netmask: str
    mtu_bytes: int
    hosts: str


class NoNamespace(Exception):
    """It cannot be made; the text says why, and what to do."""


_libc: Final = ctypes.CDLL(None, use_errno=True)


def _called(name: str, *arguments: object) -> None:
    """Call a function of libc.

    Raises:
        OSError: it failed.
    """
    if getattr(_libc, name)(*arguments) != 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


def enter() -> None:
    """Leave for a network and a mount namespace of our own: as root directly, else in a user namespace.

    Raises:
        NoNamespace: neither is allowed.
    """
    wanted = CLONE_NEWNET | CLONE_NEWNS
    if os.geteuid() == 0:
        with suppress(OSError):  # root in a container may lack the right, and still have user namespaces
            _called("unshare", wanted)
            return
    uid, gid = os.geteuid(), os.getegid()
    try:
        _called("unshare", wanted | CLONE_NEWUSER)
        for file, text in (("setgroups", "deny"), ("uid_map", f"0 {uid} 1"), ("gid_map", f"0 {gid} 1")):
            Path("/proc/self", file).write_text(text, encoding="ascii")
    except OSError as error:
        raise NoNamespace(
            f"no network namespace can be made here ({error.strerror}): run it as root, or let users make namespaces "
            "(sysctl user.max_user_namespaces above 0, kernel.unprivileged_userns_clone=1 on Debian, "
            "kernel.apparmor_restrict_unprivileged_userns=0 on Ubuntu; a container needs --cap-add SYS_ADMIN or a "
            "seccomp profile that allows unshare)"
        ) from error


def open_interface(settings: InterfaceSettings) -> int:
    """The interface, up; returns the file whose reads and writes are its packets.

    Raises:
        NoNamespace: there are no TUN devices here.
    """
    name = settings.interface.encode()
    try:
        tun = os.open(TUN, os.O_RDWR | os.O_CLOEXEC)
        fcntl.ioctl(tun, TUNSETIFF, struct.pack("16sH22x", name, IFF_TUN | IFF_NO_PI))
    except OSError as error:
        raise NoNamespace(
            f"{TUN}: {error.strerror}: it needs the kernel's TUN devices (modprobe tun; a container needs "
            "--device /dev/net/tun), and the right to open them"
        ) from error
    without_ipv6(settings.interface)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        fcntl.ioctl(control, SIOCSIFMTU, struct.pack("16si20x", name, settings.mtu_bytes))
        fcntl.ioctl(control, SIOCSIFADDR, struct.pack("16s16s8x", name, _sockaddr(settings.address)))
        fcntl.ioctl(control, SIOCSIFNETMASK, struct.pack("16s16s8x", name, _sockaddr(settings.netmask)))
        for each in (name, b"lo"):
            had = struct.unpack("16sH22x", fcntl.ioctl(control, SIOCGIFFLAGS, struct.pack("16s24x", each)))[1]
            fcntl.ioctl(control, SIOCSIFFLAGS, struct.pack("16sH22x", each, had | IFF_UP))
        for destination, mask in (MULTICAST, LIMITED_BROADCAST):
            fcntl.ioctl(control, SIOCADDRT, _route(destination, mask, name))
    return tun


def without_ipv6(interface: str) -> None:
    """Have the kernel send no IPv6 of its own; where that may not be said, it is dropped later."""
    with suppress(OSError):
        Path("/proc/sys/net/ipv6/conf", interface, "disable_ipv6").write_text("1", encoding="ascii")


def _sockaddr(address: str) -> bytes:
    return struct.pack("=HH4s8x", socket.AF_INET, 0, socket.inet_aton(address))


_name_buffers: Final[list[object]] = []


def _route(destination: str, mask: str, interface: bytes) -> bytes:
    """A struct rtentry (linux/route.h) of a 64-bit or a 32-bit machine; the name has to stay where it is."""
    name = ctypes.create_string_buffer(interface)
    _name_buffers.append(name)
    native = struct.Struct("@L16s16s16sHhLPhPLLH0L")
    nowhere = _sockaddr("0.0.0.0")  # the gateway: none
    ends = (_sockaddr(destination), nowhere, _sockaddr(mask))
    return native.pack(0, *ends, RTF_UP, 0, 0, 0, 0, ctypes.addressof(name), 0, 0, 0)


def name_hosts(lines: str) -> str:
    """Have /etc/hosts begin with ``lines``, in this mount namespace alone; returns why that cannot be, or "".

    The file lies on a file system of its own, which goes with the namespace.
    """
    try:
        content = lines + Path(HOSTS).read_text(encoding="utf-8", errors="surrogateescape")
        _called("mount", None, b"/", None, MS_REC | MS_PRIVATE, None)
        _called("mount", b"tmpfs", b"/tmp", b"tmpfs", 0, b"size=1m,mode=755")
        try:
            file = Path("/tmp/hosts")
            file.write_text(content, encoding="utf-8", errors="surrogateescape")
            _called("mount", b"/tmp/hosts", HOSTS.encode(), None, MS_BIND, None)
        finally:
            _called("umount2", b"/tmp", MNT_DETACH)
    except OSError as error:
        return f"names of nodes do not work ({error.strerror}): use their addresses"
    return ""


def leash(parent: int) -> None:
    """Have the kernel end the program with whoever started this."""
    _called("prctl", PR_SET_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
    if os.getppid() != parent:
        sys.exit("attach: whoever started this is gone")


def become(command: list[str]) -> NoReturn:
    """Become the program; Python ignores signals that others have."""
    for number in (signal.SIGPIPE, signal.SIGXFSZ):
        signal.signal(number, signal.SIG_DFL)
    try:
        os.execvp(command[0], command)
    except OSError as error:
        print(f"lostlink: {command[0]}: {error.strerror}", file=sys.stderr)
        sys.exit(NOT_FOUND if isinstance(error, FileNotFoundError) else CANNOT_START)


def main(open_all: Callable[[InterfaceSettings], int] = open_interface) -> None:
    """Make it, hand it over, and become the program."""
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # Python would tell of it
    settings, command = InterfaceSettings(**json.loads(sys.argv[1])), sys.argv[2:]
    with socket.socket(fileno=settings.fd) as starter:
        try:
            enter()
            tun = open_all(settings)
        except (NoNamespace, OSError) as error:
            starter.send(str(error).encode())
            sys.exit(CANNOT_START)
        remark = name_hosts(settings.hosts)
        socket.send_fds(starter, [remark.encode() or b"\0"], [tun])
        os.close(tun)
        leash(settings.parent)
        if not starter.recv(1):
            sys.exit(CANNOT_START)
    become(command)


if __name__ == "__main__":
    main()
