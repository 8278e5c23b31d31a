"""What the database raises when it cannot serve, by one name: no room above the store imports SQLAlchemy."""

from sqlalchemy.exc import OperationalError

__all__ = ["OperationalError"]
