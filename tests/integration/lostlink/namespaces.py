"""Whether programs can be attached here."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

LOSTLINK = [sys.executable, "-m", "lostlink"]


def _why_none() -> str:
    if sys.platform != "linux":
        return "network namespaces are Linux's"
    if shutil.which("unshare") is None:
        return "no unshare (util-linux) to try namespaces with"
    rights = [] if os.geteuid() == 0 else ["--user", "--map-root-user"]
    words = ["unshare", *rights, "--net", "--mount", "sh", "-c", "exec 3<> /dev/net/tun"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    return (
        "" if done.returncode == 0 else f"no network namespace with a TUN device here: {done.stderr.strip()}"
    )


WHY_NO_NAMESPACE = _why_none()
"""Why there can be no network namespace with a TUN device here; "" if there can."""
