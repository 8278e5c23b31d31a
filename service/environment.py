"""Settings that environment variables set, and what is wrong with them in words."""

from __future__ import annotations

from typing import Any, Self

from pydantic import Field, ValidationError
from pydantic.fields import FieldInfo
from pydantic_settings import BaseSettings, EnvSettingsSource, PydanticBaseSettingsSource, SettingsConfigDict

from simcore.errors import Problem, ScenarioError


class SettingsError(ScenarioError):
    """A setting out of its range; `problems` names each setting, its value and the allowed range."""


def setting(
    default: Any,
    variable: str,
    text: str,
    *,
    low: float | None = None,
    high: float | None = None,
    flag: str | None = None,
    rule: str | None = None,
    **more: Any,
) -> Any:
    """A field that an environment variable sets.

    text: what it sets, for the help. rule: what the value must be; by default the range low to high. flag: the option
    of the command line that a value out of range is blamed on.
    """
    notes: dict[str, Any] = {"text": text, "label": flag or variable, "rule": rule or f"must be {low:g} to {high:.15g}"}
    return Field(default, validation_alias=variable, json_schema_extra=notes, ge=low, le=high, **more)


class Section(BaseSettings):
    """Settings that are constructed by their fields' names, and from the environment by `load` alone."""

    model_config = SettingsConfigDict(
        frozen=True, extra="forbid", populate_by_name=True, env_ignore_empty=True, allow_inf_nan=False
    )

    def __init__(self, **values: Any) -> None:
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise SettingsError(problems_of(type(self), error)) from None

    @classmethod
    def settings_customise_sources(  # type: ignore[override]
        cls, _settings_cls: type[BaseSettings], init_settings: PydanticBaseSettingsSource, **_sources: Any
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        """The arguments alone: what a test or a caller constructs is not changed by the environment."""
        return (init_settings,)

    @classmethod
    def from_environment(cls, **given: Any) -> Self:
        """Arguments first (None = not given), then environment variables, then defaults. Raises SettingsError."""
        fields = {info.validation_alias: name for name, info in cls.model_fields.items() if info.validation_alias}
        found = {fields[key]: value for key, value in EnvSettingsSource(cls)().items() if key in fields}
        return cls(**{**found, **{name: value for name, value in given.items() if value is not None}})


def variables_of(section: type[Section]) -> list[FieldInfo]:
    """The fields that environment variables set."""
    return [info for info in section.model_fields.values() if info.validation_alias is not None]


def note_of(info: FieldInfo, name: str) -> str:
    """What `setting` noted of a field: its text, label or rule."""
    notes = info.json_schema_extra
    return str(notes.get(name, "")) if isinstance(notes, dict) else ""


def problems_of(section: type[Section], error: ValidationError) -> list[Problem]:
    """What pydantic found, in the words of this service: variable or flag, value, allowed range."""
    fields = {str(info.validation_alias or name): info for name, info in section.model_fields.items()}
    fields |= section.model_fields
    problems = []
    for fault in error.errors(include_url=False, include_context=False):
        info, value = fields.get(str(fault["loc"][0])), fault["input"]
        if info is None:
            raise TypeError(f"{section.__name__} has no setting {fault['loc'][0]}") from None
        variable = str(info.validation_alias or note_of(info, "label"))
        if fault["type"].startswith(("int_", "float_")):
            kind = "a whole number" if fault["type"].startswith("int_") else "a number"
            problems.append(Problem(variable, str(value)[:100], f"must be {kind}"))
        elif not info.repr:
            problems.append(Problem(variable, "(hidden)", note_of(info, "rule")))
        else:
            problems.append(Problem(note_of(info, "label") or variable, _as_number(value), note_of(info, "rule")))
    return problems


def _as_number(value: Any) -> Any:
    """'0' -> 0: out of the environment comes text."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        return value
    return int(number) if number.is_integer() else number
