"""What run and controller tell each other: one JSON object a line, in turn.

    run         start                                        once, when the controller has connected
    controller  ready                                        once
    run         observation                                  at the beginning of a step
    controller  command, for that step; or stop              the answer
    run         end                                          once; then the connection is closed

SI units, world frame. Quaternions are w, x, y, z. A field that is not known to the reader is to be passed over: fields
may be added within a version, and are never taken away or changed.
"""

from __future__ import annotations

import json
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, TypeAdapter, ValidationError

PROTOCOL = "needlebench/remote/1"
LONGEST_TEXT = 200

Vector3 = tuple[FiniteFloat, FiniteFloat, FiniteFloat]
Quaternion = tuple[FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat]
Text = Annotated[str, Field(max_length=LONGEST_TEXT)]


class _Message(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore", hide_input_in_errors=True, strict=True)

    def line(self) -> bytes:
        """As it is sent."""
        return self.model_dump_json().encode() + b"\n"


class Start(_Message):
    """What stays the same during the run."""

    type: Literal["start"] = "start"
    protocol: str = PROTOCOL
    dt_s: float = Field(description="time from step to step, s")
    steps: int = Field(description="how many commands will be asked for, if nothing ends the run before")
    entry_m: Vector3 = Field(description="where the needle enters: the remote centre of motion")
    needle_length_m: float = Field(description="from the base to the tip, m")
    seed: int = Field(description="for what the controller draws itself; not that of the run's noise")
    settings: dict[str, Any] = Field(description="`controller.settings` of the scenario")
    scenario: dict[str, Any] = Field(description="the whole scenario, resolved, in its own units")


class Ready(_Message):
    """The controller has understood."""

    type: Literal["ready"] = "ready"
    protocol: str = Field(default=PROTOCOL, description="the version that it speaks")


class ObservationMessage(_Message):
    """What is seen at the beginning of a step."""

    type: Literal["observation"] = "observation"
    step: int = Field(description="from 0")
    t_s: float = Field(description="since the start, s")
    base_position_m: Vector3 = Field(description="of the needle's base, where the robot is now")
    base_quaternion: Quaternion = Field(description="its rotation; the needle leaves the base along its z axis")
    base_force_n: Vector3 = Field(description="of the robot on the needle")
    base_torque_nm: Vector3 = Field(description="of the robot on the needle, about the base")
    tip_m: Vector3 = Field(description="as it is seen, see `sensing`")
    tip_direction: Vector3 = Field(description="of the needle at its tip, unit, as it is seen")
    depth_m: float = Field(description="inserted length, as it is seen")
    entry_offset_m: tuple[FiniteFloat, FiniteFloat] = Field(description="how far the shaft passes beside the entry")
    target_m: Vector3 = Field(description="where the tip is to be at the end of this step, with noise")
    coming_m: list[Vector3] = Field(description="targets of the next steps, at most `controller.look_ahead`")


class CommandMessage(_Message):
    """The pose of the base that is wanted at the end of the step, before the robot's limits."""

    type: Literal["command"]
    step: int = Field(description="of the observation that it answers")
    position_m: Vector3
    quaternion: Quaternion | None = Field(
        default=None, description="need not be of length 1; left out or null = the rotation stays as it is"
    )


class Stop(_Message):
    """The controller gives up: the run ends as `controller_failed` with this reason."""

    type: Literal["stop"]
    reason: Text = ""


class End(_Message):
    """How the run ended."""

    type: Literal["end"] = "end"
    status: str = Field(description="of result.json, or interrupted: cancelled, Ctrl-C")
    message: str


Answer = Annotated[CommandMessage | Stop, Field(discriminator="type")]
_ANSWER: TypeAdapter[CommandMessage | Stop] = TypeAdapter(Answer)
_READY: TypeAdapter[Ready | Stop] = TypeAdapter(Annotated[Ready | Stop, Field(discriminator="type")])
SENT, ANSWERED = (Start, ObservationMessage, End), (Ready, CommandMessage, Stop)


class NonsenseError(ValueError):
    """A line that is no message of this moment; the text says what it is instead."""


def read_answer(line: bytes) -> CommandMessage | Stop:
    """The answer to an observation. Raises NonsenseError."""
    answer: CommandMessage | Stop = _read(_ANSWER, line, "a command or stop")
    return answer


def read_ready(line: bytes) -> Ready | Stop:
    """The answer to the start. Raises NonsenseError."""
    ready: Ready | Stop = _read(_READY, line, "ready or stop")
    return ready


def _read(adapter: TypeAdapter[Any], line: bytes, wanted: str) -> Any:
    try:
        return adapter.validate_json(line)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        text = line[:80].decode("utf-8", "backslashreplace").strip()
        raise NonsenseError(
            f"{wanted} was expected, {text!r} came: {where + ': ' if where else ''}{first['msg']}"
        ) from None


def message_schema() -> dict[str, Any]:
    """JSON Schema of every message, by its type."""
    messages = {model.model_fields["type"].annotation.__args__[0]: model for model in (*SENT, *ANSWERED)}  # type: ignore[union-attr]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": PROTOCOL,
        "description": "One JSON object a line; SI units, world frame, quaternions w, x, y, z.",
        "$defs": {name: model.model_json_schema() for name, model in messages.items()},
    }


def schema_text() -> str:
    """The schema as it is printed."""
    return json.dumps(message_schema(), indent=2) + "\n"
