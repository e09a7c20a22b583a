"""Move files to and from an autopilot with MAVSDK (pip install mavsdk), and fetch its shortest log.

    python mavsdk_files.py tcpout://127.0.0.1:6760

By MAVLink FTP: makes a directory, puts a file there, gets it back, compares, and clears up. By LOG_REQUEST_*: lists the
logs and gets one, of which it shows the first bytes. The stand-in has neither files nor logs, and
of ArduPilot MAVSDK 4.1 cannot list a directory.
"""

import argparse
import asyncio
import secrets
import sys
import tempfile
from pathlib import Path

from mavsdk import ComponentType, Configuration
from mavsdk.asyncio import Mavsdk
from mavsdk.asyncio.plugins.ftp import FtpAsync
from mavsdk.asyncio.plugins.log_files import LogFilesAsync

PLACE, NAME, BYTES = "exchanged", "noise.bin", 5_000


def say(*words):
    sys.stdout.write(" ".join(map(str, words)) + "\n")
    sys.stdout.flush()


async def done(progress):
    """Wait until a transfer has ended; it raises what went wrong."""
    async for _ in progress:
        pass


async def exchange_files(ftp, folder):
    ours, back = folder / NAME, folder / "back"
    ours.write_bytes(secrets.token_bytes(BYTES))
    back.mkdir()
    await ftp.create_directory(PLACE)
    await done(ftp.upload(str(ours), PLACE))
    listed = await ftp.list_directory(PLACE)
    say("there:", *(f"{entry.name} {entry.size_bytes} bytes" for entry in listed.entries))
    say("the same there:", await ftp.are_files_identical(str(ours), f"{PLACE}/{NAME}"))
    await done(ftp.download(f"{PLACE}/{NAME}", str(back), use_burst=True))
    say("the same back:", (back / NAME).read_bytes() == ours.read_bytes())
    await ftp.remove_file(f"{PLACE}/{NAME}")
    await ftp.remove_directory(PLACE)
    say("cleared up")


async def fetch_log(log_files, folder):
    entries = await log_files.get_entries()
    say("logs:", len(entries))
    entry = min(entries, key=lambda entry: entry.size_bytes)
    file = folder / "log"
    await done(log_files.download_log_file(entry, str(file)))
    data = file.read_bytes()
    say(f"log {entry.id}: {len(data)} of {entry.size_bytes} bytes, begins with {data[:4]}")


async def main(url):
    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    async with Mavsdk(configuration) as mavsdk:
        await mavsdk.add_any_connection(url)
        system = await mavsdk.first_autopilot(timeout_s=30)
        say("system:", await system.get_system_id())
        with tempfile.TemporaryDirectory() as folder:
            await exchange_files(FtpAsync(system), Path(folder))
            await fetch_log(LogFilesAsync(system), Path(folder))


parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("url", nargs="?", default="tcpout://127.0.0.1:6760")
asyncio.run(main(parser.parse_args().url))
