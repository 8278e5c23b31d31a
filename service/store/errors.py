"""What a database may raise, for those above the store who can go on without it; what every kind of row may."""

from __future__ import annotations

from sqlalchemy.exc import (
    DatabaseError,
    DataError,
    DBAPIError,
    IntegrityError,
    InterfaceError,
    OperationalError,
    ProgrammingError,
    SQLAlchemyError,
)

from simcore.errors import NeedlebenchError

__all__ = [
    "REFUSED_VALUES",
    "DBAPIError",
    "DatabaseError",
    "OperationalError",
    "SQLAlchemyError",
    "VersionChangedError",
]

REFUSED_VALUES = (DataError, IntegrityError, InterfaceError, ProgrammingError)  # however often they are tried


class VersionChangedError(NeedlebenchError):
    """Somebody else changed it meanwhile: the version that a change is based on is not the newest."""
