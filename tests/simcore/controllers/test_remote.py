"""A controller at the other end of a connection: asked in lock step, the same to the bit as one in this process, and
named in every way in which it can fail; what was run until then is kept."""

from __future__ import annotations

import json
import socket
import threading
import time
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from simcore.controllers.remote import RemoteController
from simcore.episode import Observation
from simcore.errors import ControllerError, ScenarioError, Status
from simcore.insertion.state import Pose
from simcore.plugins import register_controller
from simcore.remote.link import LONGEST_LINE, Address
from simcore.remote.messages import PROTOCOL, message_schema
from simcore.rollout.records import Silent
from simcore.rollout.rollout import run
from simcore.scenario.scenario import Remote, Scenario

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from simcore.rollout.records import StepRecord
    from simcore.rollout.result import Rollout

    Said = dict[str, Any]
    Answer = Callable[[Said], Any]  # an object, bytes as they are, or None = nothing

STEPS = 20


def free_address() -> str:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return f"127.0.0.1:{server.getsockname()[1]}"


def scenario(controller: dict[str, Any], **fields: Any) -> Scenario:
    """2 mm of a coarse block."""
    return Scenario.load(
        {
            "tissue": {"element_size_mm": 12},
            "needle": {"elements": 6},
            "trajectory": {"target_mm": [18.0, 31.0, 2.0]},
            "controller": controller,
            **fields,
        }
    )


def remote(address: str, **settings: Any) -> dict[str, Any]:
    return {"kind": "remote", "name": "mine", "address": address, "connect_timeout_s": 120, **settings}


@contextmanager
def controller(address: str, answer: Answer, heard: list[Said] | None = None) -> Iterator[None]:
    """A thread that connects and answers each message; leaves when it is told the end or hung up on."""

    def serve() -> None:
        with suppress(ConnectionError), connected(address) as link, link.makefile("rb") as lines:
            for line in lines:
                said = json.loads(line)
                if heard is not None:
                    heard.append(said)
                said_back = answer(said)
                if said_back is hang_up:
                    return
                if said_back is not None:
                    link.sendall(said_back if isinstance(said_back, bytes) else json.dumps(said_back).encode() + b"\n")

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    yield
    thread.join(60.0)
    assert not thread.is_alive()


def connected(address: str) -> socket.socket:
    for _ in range(2400):  # kernels may have to be compiled
        try:
            if address.startswith("unix:"):
                return connected_unix(address.removeprefix("unix:"))
            host, port = address.rsplit(":", 1)
            return socket.create_connection((host, int(port)))
        except OSError:
            time.sleep(0.05)
    raise AssertionError(f"nobody waits at {address}")


def connected_unix(path: str) -> socket.socket:
    link = socket.socket(socket.AF_UNIX)
    try:
        link.connect(path)
    except OSError:
        link.close()
        raise
    return link


def hang_up() -> None:
    """An answer: the connection is closed."""


def steers(said: Said, gain: float = 1.0) -> Said | None:
    """The base moves with the tip's error."""
    if said["type"] == "start":
        return {"type": "ready", "protocol": PROTOCOL}
    if said["type"] == "end":
        return None
    error = np.array(said["target_m"]) - np.array(said["tip_m"])
    return {
        "type": "command",
        "step": said["step"],
        "position_m": (np.array(said["base_position_m"]) + gain * error).tolist(),
    }


def fails_at(step: int, answer: Any) -> Answer:
    return lambda said: answer if said["type"] == "observation" and said["step"] == step else steers(said)


def run_with(answer: Answer, heard: list[Said] | None = None, **settings: Any) -> Rollout:
    address = free_address()
    with controller(address, answer, heard):
        return run(scenario(remote(address, **settings)))


class Inside:
    """The same law in this process."""

    limited = True

    def __init__(self, *_: Any) -> None:
        pass

    def command(self, seen: Observation) -> Pose:
        return Pose(seen.base.position_m + (seen.target_m - seen.tip_m), seen.base.rotation)


@pytest.mark.slow
def test_it_steers_as_the_same_law_in_this_process_to_the_bit() -> None:
    heard: list[Said] = []
    done = run_with(steers, heard)
    register_controller("the same law", Inside)
    inside = run(scenario({"kind": "plugin", "name": "the same law"}))
    assert done.status is Status.COMPLETED
    assert done.digest == inside.digest
    start, *observations, end = heard
    assert (start["type"], start["protocol"], start["steps"], start["dt_s"]) == ("start", PROTOCOL, STEPS, 0.01)
    np.testing.assert_allclose(start["entry_m"], [0.018, 0.031, 0.0])
    assert [said["step"] for said in observations] == list(range(STEPS))
    assert end == {"type": "end", "status": "completed", "message": ""}


@pytest.mark.slow
def test_it_is_told_what_the_scenario_says_and_not_the_seed_of_the_noise() -> None:
    heard: list[Said] = []
    run_with(steers, heard, look_ahead=3, settings={"gain": 0.5})
    start, first, *_, last, _ = heard
    assert start["settings"] == {"gain": 0.5}
    assert start["scenario"]["controller"]["name"] == "mine"
    assert start["seed"] == start["scenario"]["seed"] != 0
    assert (len(first["coming_m"]), len(last["coming_m"])) == (3, 1)
    assert first["coming_m"][0][2] > first["target_m"][2]


@pytest.mark.slow
def test_it_is_told_when_something_else_ends_the_run() -> None:
    class Cancels(Silent):
        def step(self, record: StepRecord) -> None:
            if record.step == 15:
                raise KeyboardInterrupt

    heard: list[Said] = []
    address = free_address()
    with controller(address, steers, heard), pytest.raises(KeyboardInterrupt):
        run(scenario(remote(address)), Cancels())
    assert heard[-1]["status"] == "interrupted"
    assert len(heard[1]["entry_offset_m"]) == 2
    assert heard[-2]["depth_m"] > heard[1]["depth_m"]


NONSENSE: dict[str, tuple[Any, str]] = {
    "no JSON": (b"pardon?\n", "'pardon?' came"),
    "no text": (b"\xff\xfe\n", "came: "),
    "another type": ({"type": "ready"}, "a command or stop was expected"),
    "no position": ({"type": "command", "step": 5}, "position_m: Field required"),
    "two numbers": ({"type": "command", "step": 5, "position_m": [0.0, 1.0]}, "position_m"),
    "NaN": (
        b'{"type": "command", "step": 5, "position_m": [0.0, NaN, 0.0]}\n',
        "position_m.1: Input should be a finite number",
    ),
    "text": ({"type": "command", "step": 5, "position_m": ["0", "0", "0"]}, "position_m.0"),
    "another step": ({"type": "command", "step": 4, "position_m": [0, 0, 0]}, "answered step 4, step 5"),
    "no rotation": (
        {"type": "command", "step": 5, "position_m": [0, 0, 0], "quaternion": [0, 0, 0, 0]},
        "no rotation, step 5",
    ),
    "millimetres": ({"type": "command", "step": 5, "position_m": [18, 31, -180]}, "looks like millimetres"),
    "gives up": ({"type": "stop", "reason": "singular matrix"}, "stops: singular matrix, step 5"),
    "leaves": (hang_up, "has closed the connection, step 5"),
    "never ends": (b"x" * (2 * LONGEST_LINE), f"more than {LONGEST_LINE} bytes without the end of a line, step 5"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", NONSENSE)
def test_nonsense_ends_the_run_by_name_and_keeps_what_was_run(name: str) -> None:
    answer, told = NONSENSE[name]
    done = run_with(fails_at(5, answer), step_timeout_s=5)
    assert done.status is Status.CONTROLLER_FAILED
    assert told in done.message
    assert "'mine'" in done.message
    assert done.message.startswith(f"step 6 of {STEPS}")
    assert len(done.series["tip_m"]) == 6


@pytest.mark.slow
def test_a_stall_ends_the_run_by_name() -> None:
    done = run_with(fails_at(5, None), step_timeout_s=0.2)
    assert "remote controller 'mine': has not answered within 0.2 s, step 5" in done.message
    assert len(done.series["tip_m"]) == 6


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        (lambda _: {"type": "ready", "protocol": "needlebench/remote/9"}, "speaks 'needlebench/remote/9'"),
        (lambda _: {"type": "stop", "reason": "no licence"}, "does not begin: no licence"),
        (lambda _: b"hello\n", "ready or stop was expected"),
        (lambda _: hang_up, "has closed the connection"),
    ],
)
@pytest.mark.slow
def test_a_bad_beginning_ends_the_run_before_its_first_step(answer: Answer, told: str) -> None:
    done = run_with(answer)
    assert done.status is Status.CONTROLLER_FAILED
    assert told in done.message
    assert len(done.series["tip_m"]) == 1


@pytest.mark.slow
def test_nobody_who_connects_and_an_address_that_is_taken() -> None:
    address = free_address()
    done = run(scenario(remote(address, connect_timeout_s=0.1)))
    assert "no controller has connected within 0.1 s" in done.message
    host, port = address.split(":")
    taken = pytest.raises(ControllerError, match="cannot be waited for at 127")
    with socket.create_server((host, int(port))), taken:
        run(scenario(remote(address)))


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(socket, "AF_UNIX"), reason="no Unix sockets here")
def test_over_a_unix_socket_which_is_gone_afterwards(tmp_path: Path) -> None:
    path = tmp_path / "needle.sock"
    stale = socket.socket(socket.AF_UNIX)
    stale.bind(str(path))
    stale.close()  # left by a run that was killed
    with controller(f"unix:{path}", steers):
        done = run(scenario(remote(f"unix:{path}")))
    assert done.status is Status.COMPLETED
    assert not path.exists()


class Ticking:
    """A clock that a controller's answers move on."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def observation(step: int) -> Observation:
    return Observation(
        step=step, base=Pose(np.array([0.0, 0.0, 1e-3 * step]), np.eye(3)), tip_m=np.zeros(3), target_m=np.zeros(3)
    )


def test_in_real_time_an_answer_comes_as_late_as_it_took() -> None:
    """0.025 s of 0.01 s steps: two steps go by with the last command, and nobody is asked meanwhile."""
    clock, asked = Ticking(), list[int]()

    def slow(said: Said) -> Said | None:
        if said["type"] == "observation":
            asked.append(said["step"])
            clock.now_s += 0.025
            return {"type": "command", "step": said["step"], "position_m": [1.0, 0.0, said["step"]]}
        return steers(said)

    address = free_address()
    settings = Remote(name="mine", address=address, clock="real")
    with controller(address, slow):
        steered = RemoteController(settings, scenario(remote(address)), np.zeros(3), 0.18, clock)
        commands = [steered.command(observation(step)).position_m for step in range(7)]
        steered.close("completed", "")
    assert asked == [0, 2, 4, 6]
    held = [[0, 0, 0], [0, 0, 0], [1, 0, 0], [1, 0, 0], [1, 0, 2], [1, 0, 2], [1, 0, 4]]
    np.testing.assert_array_equal(commands, held)


@pytest.mark.parametrize(
    "address",
    [
        "",
        "7717",
        "127.0.0.1",
        "127.0.0.1:0",
        "127.0.0.1:65536",
        "0.0.0.0:7717",
        "192.168.1.2:7717",
        "example.org:80",
        "unix:",
        "127.0.0.1:٧٧",
    ],
)
def test_an_address_that_is_not_on_this_machine_is_refused(address: str) -> None:
    with pytest.raises(ScenarioError, match=r"controller\.address"):
        scenario(remote(address))


def test_addresses_that_are() -> None:
    for text, host in (
        ("127.0.0.1:7717", "127.0.0.1"),
        ("localhost:1", "127.0.0.1"),
        ("[::1]:80", "::1"),
        ("127.8.0.1:9", "127.8.0.1"),
    ):
        assert Address.parse(text).host == host


def test_the_schema_has_every_message_with_units() -> None:
    schema = message_schema()
    assert set(schema["$defs"]) == {"start", "ready", "observation", "command", "stop", "end"}
    assert set(schema["$defs"]["command"]["required"]) == {"type", "step", "position_m"}
    json.dumps(schema)
