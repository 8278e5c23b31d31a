"""What a database may raise, for those above the store who can go on without it."""

from __future__ import annotations

from sqlalchemy.exc import DatabaseError, DBAPIError, OperationalError, SQLAlchemyError

__all__ = ["DBAPIError", "DatabaseError", "OperationalError", "SQLAlchemyError"]
