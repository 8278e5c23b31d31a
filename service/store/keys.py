"""API keys and the sessions of browsers, as the database keeps them: hashed."""

from __future__ import annotations

import hmac
import secrets
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sqlalchemy import Row, delete, insert, select, update
from sqlalchemy.exc import OperationalError

from service.access import ADMIN, SCOPES, Caller
from service.api_key import digest_of, id_of, new_key
from service.store.schema import api_key, session
from simcore.errors import NeedlebenchError, Problem, ScenarioError

if TYPE_CHECKING:
    from service.store.jobs import Store

ENVIRONMENT = "environment"  # the id of the key in NEEDLEBENCH_API_KEY
LOCAL = "local"  # of the token in the data folder, which counts as long as there are no keys
SESSION_S = 12 * 3600.0
NOTE_LENGTH = 200
_USE_NOTED_S = 60.0
_ASKED_AGAIN_S = 1.0


class UnknownKeyError(NeedlebenchError, LookupError):
    """There is no key of this id."""


@dataclass(frozen=True, kw_only=True)
class ApiKey:
    """A key without its secret. Times are UTC seconds since 1970."""

    id: str
    scope: str
    note: str
    created_at: float
    used_at: float | None
    revoked_at: float | None


_SHOWN = [api_key.c[name] for name in ApiKey.__dataclass_fields__]


class Keys:
    """Who has which key. environment_key: the one that the service was started with, of scope admin."""

    def __init__(self, store: Store, *, environment_key: str | None = None, always: bool = False) -> None:
        self._store = store
        self._environment_sha256 = None if environment_key is None else digest_of(environment_key)
        self._always = always or environment_key is not None
        self._local_sha256: str | None = None
        self._any = True
        self._asked_at = -_ASKED_AGAIN_S

    def take_local_token(self, token: str) -> None:
        """What the account of the service says where no key is required and the system does not say who is asking."""
        self._local_sha256 = digest_of(token)

    # -- keys

    def create(self, *, scope: str, note: str = "") -> tuple[ApiKey, str]:
        """A new key and its text, which cannot be shown again. Raises ScenarioError."""
        if scope not in SCOPES:
            raise ScenarioError([Problem("scope", scope, f"must be {', '.join(SCOPES)}")])
        if len(note) > NOTE_LENGTH or not note.isprintable():
            raise ScenarioError([Problem("note", note, f"must be at most {NOTE_LENGTH} printable characters")])
        key, key_id = new_key()
        row = {"id": key_id, "secret_sha256": digest_of(key), "scope": scope, "note": note}
        with self._store.writing() as connection:
            connection.execute(insert(api_key).values(**row, created_at=self._store.now))
        self._any, self._asked_at = True, time.monotonic()
        return self.get(key_id), key

    def get(self, key_id: str) -> ApiKey:
        """Raises UnknownKeyError."""
        with self._store.reading() as connection:
            row = connection.execute(select(*_SHOWN).where(api_key.c.id == key_id)).one_or_none()
        if row is None:
            raise UnknownKeyError(f"there is no key {key_id}")
        return ApiKey(**row._mapping)

    def all(self) -> list[ApiKey]:
        """Oldest first, the revoked ones too."""
        with self._store.reading() as connection:
            rows = connection.execute(select(*_SHOWN).order_by(api_key.c.created_at, api_key.c.id))
            return [ApiKey(**row._mapping) for row in rows]

    def revoke(self, key_id: str) -> ApiKey:
        """End the key and its sessions. Idempotent. Raises UnknownKeyError."""
        change = update(api_key).where(api_key.c.id == key_id, api_key.c.revoked_at.is_(None))
        with self._store.writing() as connection:
            connection.execute(change.values(revoked_at=self._store.now))
            connection.execute(delete(session).where(session.c.key_id == key_id))
        self._asked_at = -_ASKED_AGAIN_S
        return self.get(key_id)

    def wanted(self) -> bool:
        """Whether requests must bring a key: since the first one was made, and for good: a service does not open
        because its last key is revoked. Asks the database at most once a second."""
        lately = self.wanted_lately
        if lately is not None:
            return lately
        query = select(api_key.c.id).limit(1)
        with self._store.reading() as connection:
            self._any = connection.execute(query).one_or_none() is not None
        self._asked_at = time.monotonic()
        return self._any

    @property
    def wanted_lately(self) -> bool | None:
        """The same without asking the database; None when the answer is older than a second."""
        if self._always:
            return True
        return self._any if time.monotonic() - self._asked_at < _ASKED_AGAIN_S else None

    # -- who it is

    def caller(self, key: str) -> Caller | None:
        """Whoever has this key; None for an unknown or revoked one."""
        found = self._checked(key)
        return None if found is None else _caller(found[0], found[1])

    def _checked(self, key: str) -> tuple[str, str, str] | None:
        """Id, scope and digest of a key that is good."""
        digest = digest_of(key)
        if self._environment_sha256 is not None and hmac.compare_digest(digest, self._environment_sha256):
            return ENVIRONMENT, ADMIN, digest
        if self._is_local(digest):
            return LOCAL, ADMIN, digest
        row = self._row(id_of(key))
        if row is None or not hmac.compare_digest(digest, row.secret_sha256):
            return None
        self._note_use(row)
        return row.id, row.scope, digest

    def _is_local(self, digest: str) -> bool:
        known = self._local_sha256
        return known is not None and hmac.compare_digest(digest, known) and not self.wanted()

    def _row(self, key_id: str | None) -> Row[Any] | None:
        if key_id is None:
            return None
        with self._store.reading() as connection:
            query = select(api_key).where(api_key.c.id == key_id, api_key.c.revoked_at.is_(None))
            return connection.execute(query).one_or_none()

    def _note_use(self, row: Row[Any]) -> None:
        if row.used_at is not None and self._store.now - row.used_at < _USE_NOTED_S:
            return
        try:
            with self._store.writing() as connection:
                connection.execute(update(api_key).where(api_key.c.id == row.id).values(used_at=self._store.now))
        except OperationalError:  # a full disk, a locked database: reading goes on
            pass

    # -- browsers

    def log_in(self, key: str) -> str | None:
        """The token of a new session; None for a key that is not good."""
        found = self._checked(key)
        if found is None:
            return None
        key_id, _, digest = found
        token, now = secrets.token_urlsafe(32), self._store.now
        row = {"token_sha256": digest_of(token), "key_id": key_id, "secret_sha256": digest}
        with self._store.writing() as connection:
            connection.execute(delete(session).where(session.c.expires_at <= now))
            connection.execute(insert(session).values(**row, created_at=now, expires_at=now + SESSION_S))
        return token

    def log_out(self, token: str) -> None:
        """End the session, if there is one."""
        with self._store.writing() as connection:
            connection.execute(delete(session).where(session.c.token_sha256 == digest_of(token)))

    def browser(self, token: str) -> Caller | None:
        """Whoever logged in; None after the session's end or its key's."""
        query = select(session).where(
            session.c.token_sha256 == digest_of(token), session.c.expires_at > self._store.now
        )
        with self._store.reading() as connection:
            found = connection.execute(query).one_or_none()
        if found is None:
            return None
        if found.key_id == ENVIRONMENT:
            same = hmac.compare_digest(found.secret_sha256, self._environment_sha256 or "")
            return Caller(key_id=ENVIRONMENT, scope=ADMIN, by_cookie=True) if same else None
        if found.key_id == LOCAL:
            return _caller(LOCAL, ADMIN, by_cookie=True) if self._is_local(found.secret_sha256) else None
        row = self._row(found.key_id)
        return None if row is None else Caller(key_id=row.id, scope=row.scope, by_cookie=True)


def _caller(key_id: str, scope: str, *, by_cookie: bool = False) -> Caller:
    """Whoever has the key of this id; the token of the data folder is no key, and what it makes has no owner."""
    return Caller(key_id=None if key_id == LOCAL else key_id, scope=scope, by_cookie=by_cookie)
