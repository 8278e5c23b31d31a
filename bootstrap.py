"""Make this checkout's environment, then run a command in it; a second call finds everything in place.

    python bootstrap.py                      make or mend .venv with what running needs
    python bootstrap.py needlebench demo     the same, then run that command from it
    python bootstrap.py --dev pytest         with what testing needs on top
    python bootstrap.py --core needlebench run line --out results/line --set recording.enabled=false
                                             no more than an insertion without a recording needs

Standard library only, and readable by Python 3.8, so that an old Python can look for a newer one. Every package
comes from requirements-core.lock, requirements.lock or requirements-dev.lock: exact versions, checked against
their hashes, wheels only. Each holds the one before it, in the same versions: an environment that has the larger
set is left alone where the smaller one is asked for.

BOOTSTRAP_VENV names another folder than .venv, made for the very Python that runs this script.
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
from typing import TYPE_CHECKING, Any, NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parent))  # PYTHONSAFEPATH may have kept it out
from bootstrap_python import EXE, WINDOWS, Problem, candidates, find_python, probe, suits, version_range

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parent
OTHER_VENV = os.environ.get("BOOTSTRAP_VENV")
VENV = ROOT / (OTHER_VENV or ".venv")
BIN = VENV / ("Scripts" if WINDOWS else "bin")
PYTHON = BIN / ("python" + EXE)
UNFINISHED = "unfinished"


class Packages(NamedTuple):
    """A set of packages; its sizes were measured on Linux x86-64, that on the disk with bytecode and pip."""

    lock: str
    purpose: str
    download_mb: int
    disk_mb: int


SETS = {  # each holds the one before it
    "core": Packages("requirements-core.lock", "an insertion without a recording", 130, 520),
    "run": Packages("requirements.lock", "running", 370, 1310),
    "dev": Packages("requirements-dev.lock", "testing", 510, 1810),
}
WHEEL = re.compile(r"\s*(?:Downloading|Using cached) (?:\S*/)?([A-Za-z0-9_.]+)-\S+\.whl \(([^)]+)\)")
REDIRECTS = "PIP_TARGET PIP_PREFIX PIP_ROOT PIP_USER PIP_DRY_RUN PIP_QUIET PYTHONHOME PYTHONPATH".split()


# ---- what is there, what is wanted


def digest(name: str) -> str:
    """The hash of a file of the project."""
    return hashlib.sha256((ROOT / name).read_bytes()).hexdigest()


def wanted(version: list[int], package_set: str) -> dict[str, Any]:
    """What the stamp says once that set and the project are installed for that Python."""
    names = list(SETS)[: list(SETS).index(package_set) + 1]
    return {
        "locks": {name: digest(SETS[name].lock) for name in names},
        "project": digest("pyproject.toml"),
        "python": version,
        "path": str(VENV),
    }


def complete_sets(stamp: Any) -> dict[str, str]:
    """The sets that the environment has, as their locks are now, with the hashes of these locks."""
    locks = stamp.get("locks", {}) if isinstance(stamp, dict) else {}
    return {name: lock for name, lock in locks.items() if name in SETS and lock == digest(SETS[name].lock)}


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


def plan(stamp: Any, here: dict[str, Any] | None, exists: bool, package_set: str) -> str:
    """What is to be done for that set: `nothing`, `project`, `packages` or `rebuild`.

    `here` is the probe of the environment's own Python. An environment without a stamp was made by hand: it
    is filled, never deleted. One whose larger set was interrupted still has the smaller ones.
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
    want = wanted(here["version"], package_set)
    if any(stamp.get(key) != want[key] for key in ("python", "path")):
        return "rebuild"
    if package_set not in complete_sets(stamp):
        return "rebuild" if stamp.get("partial") else "packages"
    return "nothing" if stamp.get("project") == want["project"] else "project"


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


def announce(package_set: str, stamp: Any) -> None:
    """Say what will be installed and how large it is, and refuse to begin what cannot end."""
    asked, has = SETS[package_set], [SETS[name] for name in complete_sets(stamp)]
    download_mb = asked.download_mb - max([each.download_mb for each in has], default=0)
    disk_mb = asked.disk_mb - max([each.disk_mb for each in has], default=0)
    size = f"at most {download_mb} MB to download, {disk_mb} MB{' more' if has else ''} in {VENV.name}"
    print(f"Installing what {asked.purpose} needs: {size}.", flush=True)
    free_mb = shutil.disk_usage(str(ROOT)).free // 10**6
    if free_mb < disk_mb + 200:
        raise Problem(f"{free_mb} MB are free in {ROOT}; {disk_mb + 200} MB are needed.")


def make_environment() -> None:
    """An empty environment, marked unfinished from its first moment on."""
    found = find_python([[sys.executable]] if OTHER_VENV else candidates())
    print("Python {}.{}.{}: {}".format(*found["version"], found["executable"]), flush=True)
    if VENV.exists():
        print(f"Replacing the unfinished or outdated {VENV.name}.")
        shutil.rmtree(str(VENV))
    VENV.mkdir()
    write_stamp(UNFINISHED)
    call([found["executable"], "-I", "-m", "venv", str(VENV)], f"making {VENV.name}")


def mark_partial(stamp: Any) -> None:
    """Note, before packages are added, which sets will stay complete whatever happens: those that are so now."""
    if stamp is not None:
        kept = complete_sets(stamp)
        write_stamp({**stamp, "locks": kept, "partial": True} if kept else UNFINISHED)


def install_packages(package_set: str) -> None:
    """Exactly the lock: exact versions, hashes checked, wheels only."""
    options = ["--require-hashes", "--only-binary=:all:", "--no-deps"]
    pip_install(*options, "-r", str(ROOT / SETS[package_set].lock), text="asking for the packages")


def install_project() -> None:
    """The checkout itself: the `needlebench` command and its metadata; the code stays where it is."""
    arguments = ["--no-index", "--no-deps", "--no-build-isolation", "--editable", str(ROOT)]
    pip_install(*arguments, text="installing needlebench from this folder")


def ensure(package_set: str) -> None:
    """Bring the environment to what the set's lock and pyproject.toml say."""
    stamp = read_stamp()
    todo = plan(stamp, probe([str(PYTHON)]) if PYTHON.exists() else None, VENV.exists(), package_set)
    if todo == "nothing":
        return
    start = time.monotonic()
    if todo == "rebuild":
        announce(package_set, None)
        make_environment()
    elif todo == "packages":
        announce(package_set, stamp)
        mark_partial(stamp)
    if todo != "project":
        install_packages(package_set)
    here = probe([str(PYTHON)])
    if here is None:
        raise Problem(f"{PYTHON} does not run.")
    complete = wanted(here["version"], package_set)
    if todo == "project":
        complete = {**stamp, "project": complete["project"]}
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
    package_set = "run"
    if arguments and arguments[0] in ("--core", "--dev"):
        package_set, arguments = arguments[0][2:], arguments[1:]
    try:
        with only_one():
            ensure(package_set)
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
