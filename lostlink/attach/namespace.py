"""Makes a network namespace with one interface, and runs a program in it: ``namespace.py SETTINGS PROGRAM ARG...``.

SETTINGS is a JSON object, see `InterfaceSettings`. Whoever starts it gets three files through the socket of
`InterfaceSettings.fd`: the other side of the interface (a TUN device: whole IP packets), and the pidfds of the
namespace's init and of the program. It answers with a byte when the program may start. The message with the files is a
remark, empty if all went well, and a message without them says why it could not be made. The last one is a number: how
many packets the interface dropped, since they were not read in time.

The processes are three: this one, which waits; the init of a PID namespace, its child; and the program, that one's
child. Each dies with the one before it, and with the init the kernel kills all that is left in the namespace, in
whatever session or group it is. SIGTERM to the init goes to all of them.
"""

from __future__ import annotations

import ctypes
import errno
import fcntl
import json
import os
import signal
import socket
import struct
import sys
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple, NoReturn

CLONE_NEWNS, CLONE_NEWUSER, CLONE_NEWPID, CLONE_NEWNET = 0x00020000, 0x10000000, 0x20000000, 0x40000000
MS_NOSUID, MS_NODEV, MS_NOEXEC = 0x2, 0x4, 0x8
MS_BIND, MS_REC, MS_PRIVATE, MNT_DETACH = 0x1000, 0x4000, 0x40000, 2
PR_SET_PDEATHSIG: Final = 1
TUN: Final = "/dev/net/tun"
TUNSETIFF, IFF_TUN, IFF_NO_PI = 0x400454CA, 0x0001, 0x1000
SIOCGIFFLAGS, SIOCSIFFLAGS, IFF_UP = 0x8913, 0x8914, 0x1
SIOCSIFADDR, SIOCSIFNETMASK, SIOCSIFMTU, SIOCADDRT = 0x8916, 0x891C, 0x8922, 0x890B
SIOCSIFTXQLEN: Final = 0x8943
RTF_UP: Final = 0x1
MULTICAST, LIMITED_BROADCAST = ("224.0.0.0", "240.0.0.0"), ("255.255.255.255", "255.255.255.255")
"""Address and mask of what is for all nodes."""
HOSTS: Final = "/etc/hosts"
CANNOT_START, NOT_FOUND = 126, 127
"""Exit codes of shells, for programs that cannot be run and that are not there."""
SIGNALLED: Final = 128
"""And the number of the signal: exit code of shells for a program that was ended by it."""
REST_GRACE_S: Final = 1.0
"""What a program leaves behind is asked to end, and killed after so long, wall time."""


class InterfaceSettings(NamedTuple):
    """What the namespace is to have.

    Attributes:
        fd: of the socket to whoever started this.
        interface: name of the interface.
        address, netmask: of it.
        mtu_bytes: of it.
        queue_packets: that wait in it.
        hosts: lines for /etc/hosts.
    """

    fd: int
    interface: str
    address: str
    netmask: str
    mtu_bytes: int
    queue_packets: int
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
    """Leave for namespaces of our own: as root directly, else in a user namespace.

    They are of the network and of mounts, and that of processes for children.

    Raises:
        NoNamespace: neither is allowed.
    """
    wanted = CLONE_NEWNET | CLONE_NEWNS | CLONE_NEWPID
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
        with suppress(PermissionError):  # the machine's root alone may; for others 500 wait
            fcntl.ioctl(control, SIOCSIFTXQLEN, struct.pack("16si20x", name, settings.queue_packets))
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


def own_files(hosts: str) -> str:
    """Have /etc/hosts begin with ``hosts``, and /proc and /sys show the namespace's, in this mount namespace alone.

    Returns:
        What of it cannot be, or "".
    """
    try:
        _called("mount", None, b"/", None, MS_REC | MS_PRIVATE, None)
        name_hosts(hosts)
    except OSError as error:
        return f"names of nodes do not work ({error.strerror}): use their addresses"
    for kind, place, what in (("proc", "/proc", "process ids"), ("sysfs", "/sys", "network interfaces")):
        try:
            _called(
                "mount", kind.encode(), place.encode(), kind.encode(), MS_NOSUID | MS_NODEV | MS_NOEXEC, None
            )
        except OSError as error:
            return f"{place} has {what} of this machine, not those that the program sees ({error.strerror})"
    return ""


def name_hosts(lines: str) -> None:
    """Have /etc/hosts begin with ``lines``.

    The file lies on a file system of its own, which goes with the namespace.

    Raises:
        OSError: it cannot be.
    """
    content = lines + Path(HOSTS).read_text(encoding="utf-8", errors="surrogateescape")
    _called("mount", b"tmpfs", b"/tmp", b"tmpfs", 0, b"size=1m,mode=755")
    try:
        Path("/tmp/hosts").write_text(content, encoding="utf-8", errors="surrogateescape")
        _called("mount", b"/tmp/hosts", HOSTS.encode(), None, MS_BIND, None)
    finally:
        _called("umount2", b"/tmp", MNT_DETACH)


def leash() -> None:
    """Have the kernel kill this process when its parent ends."""
    _called("prctl", PR_SET_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)


def become(command: list[str]) -> NoReturn:
    """Become the program; Python ignores signals that others have."""
    for number in (signal.SIGPIPE, signal.SIGXFSZ):
        signal.signal(number, signal.SIG_DFL)
    try:
        if not command[0]:  # Python's ValueError
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT))
        os.execvp(command[0], command)
    except OSError as error:
        print(f"lostlink: {command[0]}: {error.strerror}", file=sys.stderr)
        sys.exit(NOT_FOUND if isinstance(error, FileNotFoundError) else CANNOT_START)


def exit_code(status: int) -> int:
    """That of a shell, for a status of wait()."""
    code = os.waitstatus_to_exitcode(status)
    return code if code >= 0 else SIGNALLED - code


def be_init(starter: socket.socket, tun: int, hosts: str, command: list[str]) -> int:
    """Be the first process of the namespace: start the program, and reap what ends until nothing is left.

    Returns:
        The program's exit code.
    """
    leash()
    remark = own_files(hosts)
    program = os.fork()
    if program == 0:
        with starter:
            if not starter.recv(1):  # whoever started us is gone
                sys.exit(CANNOT_START)
        become(command)
    signal.signal(signal.SIGTERM, lambda *_: end_all())
    pidfds = [os.pidfd_open(os.getpid()), os.pidfd_open(program)]
    socket.send_fds(starter, [remark.encode() or b"\0"], [tun, *pidfds])
    starter.close()
    for each in (tun, *pidfds):
        os.close(each)
    ended, status = os.wait()
    while ended != program:
        ended, status = os.wait()
    reap_rest(exit_code(status))
    return exit_code(status)


def dropped_packets(interface: str) -> int:
    """How many packets the interface had no room for; 0 where /sys does not show the namespace's."""
    with suppress(OSError):
        return int(Path("/sys/class/net", interface, "statistics/tx_dropped").read_text(encoding="ascii"))
    return 0


def reap_rest(code: int) -> None:
    """End what the program has left; what does not end in time the kernel kills when this process exits."""
    signal.signal(signal.SIGALRM, lambda *_: os._exit(code))
    signal.setitimer(signal.ITIMER_REAL, REST_GRACE_S)
    end_all()
    with suppress(ChildProcessError):
        while True:
            os.wait()


def end_all() -> None:
    """Ask all processes of the namespace but this one to end."""
    with suppress(ProcessLookupError):
        os.kill(-1, signal.SIGTERM)


def main() -> None:
    """Make it, and wait for its end with the program's exit code."""
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # Python would tell of it
    settings, command = InterfaceSettings(**json.loads(sys.argv[1])), sys.argv[2:]
    with socket.socket(fileno=settings.fd) as starter:
        try:
            enter()
            tun = open_interface(settings)
        except (NoNamespace, OSError) as error:
            starter.send(str(error).encode())
            sys.exit(CANNOT_START)
        leash()
        init = os.fork()
        if init == 0:
            sys.exit(be_init(starter, tun, settings.hosts, command))
        os.close(tun)
        for number in (signal.SIGINT, signal.SIGQUIT, signal.SIGHUP, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)  # the program gets them, too
        status = os.waitpid(init, 0)[1]
        with suppress(OSError):  # whoever started this is gone
            starter.send(str(dropped_packets(settings.interface)).encode())
    sys.exit(exit_code(status))


if __name__ == "__main__":
    main()
