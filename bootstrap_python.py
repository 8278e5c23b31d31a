"""Which Python makes the environment: the first that suits the locks, or the one command that installs it.

Standard library only, and readable by Python 3.8, as bootstrap.py.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

WINDOWS = os.name == "nt"
EXE = ".exe" if WINDOWS else ""
OLDEST, NEWEST = (3, 11), (3, 15)  # every package of the locks has wheels for these
PREFERRED = ("3.13", "3.12", "3.11", "3.14", "3.15")

PROBE = """
import importlib.util as util, json, platform, sys, sysconfig
print(json.dumps({
    "version": list(sys.version_info[:3]),
    "executable": getattr(sys, "_base_executable", None) or sys.executable,
    "venv": all(util.find_spec(name) for name in ("venv", "ensurepip")),
    "pip": util.find_spec("pip") is not None,
    "fits": platform.python_implementation() == "CPython" and sys.maxsize > 2**32
            and not sysconfig.get_config_var("Py_GIL_DISABLED"),
}))
"""


class Problem(Exception):
    """Something the user has to mend; the message says how."""


def candidates() -> Iterator[list[str]]:
    """Commands that may start a Python: the running one, then by version and by name on PATH."""
    yield [sys.executable]
    if WINDOWS:
        for version in PREFERRED:
            yield ["py", "-" + version]
    folders = os.environ.get("PATH", os.defpath).split(os.pathsep)
    folders += ["/opt/homebrew/bin", "/usr/local/bin", "/usr/bin"]
    for name in ["python" + version for version in PREFERRED] + ["python3", "python"]:
        for folder in dict.fromkeys(folders):
            path = os.path.join(folder, name + EXE)
            if folder and os.path.isfile(path) and os.access(path, os.X_OK):
                yield [path]


def probe(command: list[str]) -> dict[str, Any] | None:
    """What that Python says of itself; None if it does not run (a shim without a version behind it, say)."""
    try:
        done = subprocess.run(
            [*command, "-I", "-c", PROBE],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=30,
            check=True,
        )
        found: dict[str, Any] = json.loads(done.stdout.decode())
        return found
    except (OSError, ValueError, subprocess.SubprocessError):
        return None


def suits(found: dict[str, Any]) -> bool:
    """Whether the locked packages have wheels for that Python."""
    return bool(found["fits"]) and OLDEST <= tuple(found["version"][:2]) <= NEWEST


def find_python(commands: Iterable[list[str]]) -> dict[str, Any]:
    """The first Python that suits and can make an environment, or a Problem with the command for it."""
    without_venv = None
    for command in commands:
        found = probe(command)
        if found is None or not suits(found):
            continue
        if found["venv"]:
            return found
        without_venv = without_venv or found
    if without_venv:
        raise Problem(advice_without_venv(without_venv))
    raise Problem(advice_without_python())


def version_range() -> str:
    """The Pythons that the lock was made for."""
    return "{}.{} to {}.{}".format(*OLDEST, *NEWEST)


def sudo() -> str:
    """The prefix of a command that needs the administrator."""
    return "" if WINDOWS or os.geteuid() == 0 else "sudo "


def advice_without_venv(found: dict[str, Any]) -> str:
    """The command that adds the missing venv module to a Python that has none."""
    version = "{}.{}".format(*found["version"])
    way = f"Install Python {version} from python.org."
    if shutil.which("apt-get"):
        way = f"Type:\n\n    {sudo()}apt-get install python{version}-venv\n"
    return f"Python {version} ({found['executable']}) has no venv module. {way}"


def advice_without_python() -> str:
    """The command that installs a Python here."""
    ways = [
        ("apt-get", sudo() + "apt-get install python3.11 python3.11-venv"),
        ("dnf", sudo() + "dnf install python3.12"),
        ("brew", "brew install python@3.13"),
        ("winget", "winget install Python.Python.3.13"),
    ]
    here = [f"Type:\n\n    {line}\n" for tool, line in ways if shutil.which(tool)]
    way = here[0] if here else "Install Python 3.13 from python.org."
    return f"No Python {version_range()} (CPython, 64 bit) was found. {way}"
