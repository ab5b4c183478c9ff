"""Who may talk to the page: this computer's browser, with the token that was printed.

Loopback alone is no protection: any page that a browser shows may send requests to it, and by a
name that suddenly points to 127.0.0.1 (DNS rebinding) read the answers. So the `Host` has to be
the server's own, an `Origin` the same, and each request has to bring the token: in the address
once, then in a cookie that no other site's request carries.
"""

from __future__ import annotations

import secrets
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

__all__ = ["TOKEN_HEADER", "Guard"]

TOKEN_HEADER = "X-Percept-Token"  # noqa: S105 - a header's name
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS = {
    "Content-Security-Policy": _POLICY,
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
_READING = ("GET", "HEAD")


class Guard:
    """ASGI middleware that refuses what does not come from the page itself.

    Args:
        app: What it guards.
        token: The secret that every request has to bring.
        port: Port of the server on the loopback interface.
    """

    def __init__(self, app: ASGIApp, token: str, port: int) -> None:
        self._app = app
        self._token = token
        self._hosts = (f"127.0.0.1:{port}", f"localhost:{port}")
        # Cookies know no ports: the name keeps the pages of two runs apart.
        self._cookie = f"percept_review_{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer 403, or hand a request on and add the headers that bind the browser."""
        if scope["type"] != "http":
            return  # there are no web sockets here
        reason = self._refusal(scope)

        async def send_bound(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers.update(_HEADERS)
                if reason is None and self._in_address(scope):
                    cookie = f"{self._cookie}={self._token}; HttpOnly; SameSite=Strict; Path=/"
                    headers.append("Set-Cookie", cookie)
            await send(message)

        app = self._app if reason is None else PlainTextResponse(f"{reason}\n", status_code=403)
        await app(scope, receive, send_bound)

    def _refusal(self, scope: Scope) -> str | None:
        headers = Headers(scope=scope)
        host, origin = headers.getlist("host"), headers.getlist("origin")
        if len(host) != 1 or host[0] not in self._hosts:
            return "refused: this is not the address of the page"
        if origin and origin != [f"http://{host[0]}"]:
            return "refused: the request comes from another page"
        by_header = self._matches(headers.get(TOKEN_HEADER, ""))
        if scope["method"] not in _READING and not origin and not by_header:
            return "refused: a request that changes something has to name its origin"
        if by_header or self._in_cookie(headers) or self._in_address(scope):
            return None
        return "refused: open the address that `percept map review` printed"

    def _in_cookie(self, headers: Headers) -> bool:
        try:
            found = SimpleCookie(headers.get("cookie", "")).get(self._cookie)
        except CookieError:
            return False
        return found is not None and self._matches(found.value)

    def _in_address(self, scope: Scope) -> bool:
        """Return whether the token stands in the address, which only the page itself takes."""
        if scope["path"] != "/" or scope["method"] not in _READING:
            return False
        values = parse_qs(scope["query_string"].decode("latin-1")).get("token", [])
        return len(values) == 1 and self._matches(values[0])

    def _matches(self, text: str) -> bool:
        return secrets.compare_digest(text.encode(), self._token.encode())
