"""Authentication of requests: tokens, sessions, and the login form."""

from urllib.parse import parse_qs

from fastapi import APIRouter, HTTPException, Request
from fastapi.responses import RedirectResponse

from windsysid.live.page.access import COOKIE, SESSION_SECONDS, Access, Role
from windsysid.live.page.guard import Buckets, RequestLimits, client_of

__all__ = ["Door"]

CHALLENGE = {"WWW-Authenticate": "Bearer"}

SEE_OTHER = 303


class Door:
    """Finds out who asks; calling it is a dependency of FastAPI."""

    def __init__(self, access: Access, limits: RequestLimits) -> None:
        self._access = access
        self._guesses = Buckets(limits.guesses / 60.0, limits.guesses, limits.clients)

    @property
    def asks(self) -> bool:
        """Check whether a token is required."""
        return self._access.asked

    def __call__(self, request: Request) -> Role:
        """The role of a request; HTTPException 401 without a token that is known, 429 after too many wrong ones."""
        if not self._access.asked:
            return "operator"
        found = self._access.role_of_headers(request.scope["headers"])
        if found is not None:
            return found
        if request.headers.get("authorization", "").partition(" ")[0].lower() == "bearer":
            self._count_guess(request)
            raise HTTPException(401, "unknown token", CHALLENGE)
        raise HTTPException(401, "expected a token: log in, or send Authorization: Bearer …", CHALLENGE)

    def operator(self, request: Request) -> Role:
        """As calling it, for operators only; HTTPException 403 for readers."""
        role = self(request)
        if role != "operator":
            raise HTTPException(403, "expected the operator's token: this one is read-only")
        return role

    def routes(self) -> APIRouter:
        """Login and logout, for browsers."""
        router = APIRouter(include_in_schema=False)

        @router.post("/login")
        async def login(request: Request) -> RedirectResponse:
            form = parse_qs((await request.body()).decode("utf-8", "replace"))
            token = form.get("token", [""])[0].strip()
            role = self._access.role(token) if self._access.asked else None
            if self._access.asked and role is None:
                self._count_guess(request)
            answer = RedirectResponse("/" if role else "/#login-failed", SEE_OTHER)
            if role is not None:
                answer.set_cookie(
                    COOKIE, self._access.session(role), max_age=SESSION_SECONDS, httponly=True, samesite="strict",
                    secure=request.url.scheme == "https",
                )  # fmt: skip
            return answer

        @router.post("/logout")
        def logout() -> RedirectResponse:
            answer = RedirectResponse("/", SEE_OTHER)
            answer.delete_cookie(COOKIE, httponly=True, samesite="strict")
            return answer

        return router

    def _count_guess(self, request: Request) -> None:
        """Count a wrong token; HTTPException 429 after too many. A correct token is accepted whatever the count."""
        if not self._guesses.take(client_of(request.scope)):
            raise HTTPException(429, "too many wrong tokens: wait a minute", {"Retry-After": "60"})
