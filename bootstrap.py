"""Make this checkout's environment, then run a command in it; a second call finds everything in place.

    python bootstrap.py                      make or mend .venv, install the locked packages
    python bootstrap.py needlebench demo     the same, then run that command from it

Standard library only, and readable by Python 3.8, so that an old Python can look for a newer one. Every
package comes from requirements.lock: exact versions, checked against their hashes, wheels only.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parent
VENV = ROOT / ".venv"
WINDOWS = os.name == "nt"
BIN = VENV / ("Scripts" if WINDOWS else "bin")
EXE = ".exe" if WINDOWS else ""
PYTHON = BIN / ("python" + EXE)
OLDEST, NEWEST = (3, 11), (3, 15)  # every package of the lock has wheels for these
PREFERRED = ("3.13", "3.12", "3.11", "3.14", "3.15")
DOWNLOAD_MB, DISK_MB = 390, 1300  # measured on Linux x86-64; rerun-sdk is 170 and 500 of it
UNFINISHED = "unfinished"
WHEEL = re.compile(r"\s*(?:Downloading|Using cached) (?:\S*/)?([A-Za-z0-9_.]+)-\S+\.whl \(([^)]+)\)")
REDIRECTS = "PIP_TARGET PIP_PREFIX PIP_ROOT PIP_USER PIP_DRY_RUN PIP_QUIET PYTHONHOME PYTHONPATH".split()

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


# ---- which Python


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


def find_python() -> dict[str, Any]:
    """The first Python that suits and can make an environment, or a Problem with the command for it."""
    without_venv = None
    for command in candidates():
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


# ---- what is there, what is wanted


def digest(name: str) -> str:
    """The hash of a file of the project."""
    return hashlib.sha256((ROOT / name).read_bytes()).hexdigest()


def wanted(version: list[int]) -> dict[str, Any]:
    """What the stamp says once everything is installed for that Python."""
    return {
        "lock": digest("requirements.lock"),
        "project": digest("pyproject.toml"),
        "python": version,
        "path": str(VENV),
    }


def read_stamp() -> Any:
    """The stamp: a dictionary when complete, UNFINISHED after an interruption, None if there is none."""
    try:
        return json.loads((VENV / "bootstrap.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def write_stamp(stamp: Any) -> None:
    """Replace the stamp in one go."""
    new = VENV / "bootstrap.json.new"
    new.write_text(json.dumps(stamp), encoding="utf-8")
    os.replace(str(new), str(VENV / "bootstrap.json"))


def plan(stamp: Any, here: dict[str, Any] | None, exists: bool) -> str:
    """What is to be done: `nothing`, `project`, `packages` or `rebuild`.

    `here` is the probe of the environment's own Python. An environment without a stamp was made by hand: it
    is filled, never deleted.
    """
    if not exists or stamp == UNFINISHED:
        return "rebuild"
    usable = here is not None and suits(here) and here["pip"]
    if stamp is None:
        if usable:
            return "packages"
        raise Problem(
            f"{VENV} was not made by this script, and has no Python {version_range()} with pip in it. "
            "Move it away and try again."
        )
    if not usable or here is None:
        return "rebuild"
    want = wanted(here["version"])
    if any(stamp.get(key) != want[key] for key in ("python", "path")):
        return "rebuild"
    if stamp.get("lock") != want["lock"]:
        return "packages"
    return "nothing" if stamp == want else "project"


# ---- installing


class Progress:
    """What is going on and for how long: one moving line on a terminal, a line every 15 s elsewhere."""

    def __init__(self, text: str) -> None:
        self.text, self.start, self.live = text, time.monotonic(), sys.stdout.isatty()
        self.over = threading.Event()
        self.thread = threading.Thread(target=self._tick, daemon=True)

    def __enter__(self) -> Progress:
        self._show()
        self.thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.over.set()
        self.thread.join()
        if self.live:
            print("\r" + " " * 78 + "\r", end="", flush=True)

    def _tick(self) -> None:
        while not self.over.wait(0.5 if self.live else 15.0):
            self._show()

    def _show(self) -> None:
        line = f"  {time.monotonic() - self.start:4.0f} s  {self.text}"
        print(f"\r{line[:78]:78}" if self.live else line, end="" if self.live else "\n", flush=True)

    def see(self, line: str) -> None:
        """Take the news out of a line of pip's output."""
        wheel = WHEEL.match(line)
        if wheel:
            self.text = f"fetching {wheel[1]} ({wheel[2]})"
        elif line.startswith("Installing collected packages") and "," in line:
            self.text = f"unpacking {line.count(',') + 1} packages"
            if not self.live:
                self._show()


def clean_environment() -> dict[str, str]:
    """The user's environment (index, proxy, certificates) without what would redirect an installation."""
    return {key: value for key, value in os.environ.items() if key not in REDIRECTS}


def call(command: list[str], text: str) -> None:
    """Run a command with its output in .venv/bootstrap.log and its news on one line."""
    log_path = VENV / "bootstrap.log"
    with log_path.open("a", encoding="utf-8") as log, Progress(text) as progress:
        process = subprocess.Popen(
            command,
            cwd=str(ROOT),
            env=clean_environment(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            universal_newlines=True,
            errors="replace",
        )
        tail: list[str] = []
        try:
            assert process.stdout is not None
            for line in process.stdout:
                log.write(line)
                if not line.startswith("Ignoring "):
                    tail = [*tail[-14:], line]
                progress.see(line)
            code = process.wait()
        finally:
            if process.poll() is None:
                process.terminate()
                process.wait()
    if code:
        words = "    ".join(tail)
        raise Problem(f"Failed: {text}. Its last words (the rest is in {log_path}):\n\n    {words}")


def pip_install(*arguments: str, text: str) -> None:
    """Install into the environment with its own pip."""
    options = ["--disable-pip-version-check", "--no-input", "--progress-bar=off"]
    call([str(PYTHON), "-Iu", "-m", "pip", "install", *options, *arguments], text)


def check_disk() -> None:
    """Refuse to begin what cannot end."""
    free_mb = shutil.disk_usage(str(ROOT)).free // 10**6
    if free_mb < DISK_MB + 200:
        raise Problem(f"{free_mb} MB are free in {ROOT}; {DISK_MB + 200} MB are needed.")


def make_environment() -> None:
    """An empty .venv, marked unfinished from its first moment on."""
    found = find_python()
    check_disk()
    print("Python {}.{}.{}: {}".format(*found["version"], found["executable"]), flush=True)
    if VENV.exists():
        print("Replacing the unfinished or outdated .venv.")
        shutil.rmtree(str(VENV))
    VENV.mkdir()
    write_stamp(UNFINISHED)
    call([found["executable"], "-I", "-m", "venv", str(VENV)], "making .venv")


def install_packages() -> None:
    """Exactly the lock: exact versions, hashes checked, wheels only."""
    options = ["--require-hashes", "--only-binary=:all:", "--no-deps"]
    pip_install(*options, "-r", str(ROOT / "requirements.lock"), text="asking for the packages")


def install_project() -> None:
    """The checkout itself: the `needlebench` command and its metadata; the code stays where it is."""
    arguments = ["--no-index", "--no-deps", "--no-build-isolation", "--editable", str(ROOT)]
    pip_install(*arguments, text="installing needlebench from this folder")


def ensure() -> None:
    """Bring the environment to what the lock and pyproject.toml say."""
    stamp = read_stamp()
    todo = plan(stamp, probe([str(PYTHON)]) if PYTHON.exists() else None, VENV.exists())
    if todo == "nothing":
        return
    start = time.monotonic()
    if todo != "project":
        print(f"Installing the locked packages: at most {DOWNLOAD_MB} MB to download, {DISK_MB} MB in .venv.")
    if todo == "rebuild":
        make_environment()
    elif todo == "packages" and stamp is not None:
        write_stamp(UNFINISHED)
    if todo != "project":
        install_packages()
    here = probe([str(PYTHON)])
    if here is None:
        raise Problem(f"{PYTHON} does not run.")
    complete = wanted(here["version"])
    write_stamp({**complete, "project": None})
    install_project()
    write_stamp(complete)
    print(f"Installed in {time.monotonic() - start:.0f} s.", flush=True)


@contextlib.contextmanager
def only_one() -> Iterator[None]:
    """Let a second bootstrap of the same checkout wait for the first."""
    try:
        import fcntl
    except ImportError:  # Windows
        yield
        return
    with open(__file__, "rb") as handle:
        with contextlib.suppress(OSError):  # a file system without locks
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield


def run(program: str, arguments: list[str]) -> int:
    """Become that program of the environment (a child of this one on Windows, which cannot do that)."""
    path = BIN / (program + EXE)
    if not path.exists():
        raise Problem(f"{VENV} has no command {program}.")
    sys.stdout.flush()
    if not WINDOWS:
        os.execv(str(path), [str(path), *arguments])
    with subprocess.Popen([str(path), *arguments]) as process:
        while True:
            with contextlib.suppress(KeyboardInterrupt):  # the program has got it too and ends by itself
                return process.wait()


def main(arguments: list[str]) -> int:
    """Environment first, then the command; the exit code is the command's."""
    if arguments and arguments[0] in ("-h", "--help"):
        print(__doc__)
        return 0
    try:
        with only_one():
            ensure()
        return run(arguments[0], arguments[1:]) if arguments else 0
    except (Problem, OSError) as problem:
        print(f"\n{problem}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\nStopped. The same command takes it up again.", file=sys.stderr)
        return 130


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # stop pip too, as on Ctrl-C
    sys.exit(main(sys.argv[1:]))
