"""What a database may raise, for those above the store who can go on without it."""

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

__all__ = ["REFUSED_VALUES", "DBAPIError", "DatabaseError", "OperationalError", "SQLAlchemyError"]

REFUSED_VALUES = (DataError, IntegrityError, InterfaceError, ProgrammingError)  # however often they are tried
