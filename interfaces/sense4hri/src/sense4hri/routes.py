"""The routes of one HTTP interface: which there are, which one a request means, and `/openapi.json`. Pure."""

import inspect
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any
from urllib.parse import unquote

from sense4hri.access import Role
from sense4hri.errors import Refusal
from sense4hri.shapes import read, schema
from sense4hri.strict_json import parse

_PARAMETER = re.compile(r"\{(\w+)\}")
REFUSALS = {
    "400": "the body, a field of it, or what the path names is wrong",
    "401": "a token is missing or wrong",
    "403": "this token, Host or Origin may not",
    "404": "there is no such thing",
    "409": "not now",
    "411": "the body comes without its length",
    "413": "the body is too long",
    "415": "the Content-Type is not application/json",
    "429": "too many wrong tokens came from this address",
    "503": "the service did not answer in time",
}


class WrongMethod(Refusal):
    """A path that is served, but not by this method. allow: the methods that are, as the header `Allow` says them."""

    def __init__(self, method: str, served: Iterable[str]) -> None:
        methods = sorted({*served})
        super().__init__(f"this path answers {', '.join(methods)}, not {method}", status=405)
        self.allow = ", ".join(f"{one}, HEAD" if one == "GET" else one for one in methods)


@dataclass(frozen=True)
class Refused:
    """What every refusal answers: one sentence, and the name of the field that is wrong, or empty."""

    error: str
    field: str


@dataclass(frozen=True)
class Nothing:
    """The body of a request that says all by its path: no fields."""


@dataclass(frozen=True)
class Route:
    """One method of one path. `{name}` in the path is a parameter, handed to the handler by that name.

    takes: the shape of the body, which the handler gets first; None: it gets none. answers: what it returns.
    """

    method: str
    path: str
    role: Role
    handler: Callable[..., Any]
    takes: Any
    answers: Any

    def parameters(self, path: str) -> dict[str, str] | None:
        """Return the parameters in a path, None where it is not this route's."""
        named = _PARAMETER.sub(r"(?P<\1>[^/]+)", self.path)
        found = re.fullmatch(named, path)
        return None if found is None else {name: unquote(value) for name, value in found.groupdict().items()}

    def arguments(self, body: bytes) -> tuple[Any, ...]:
        """Return what the handler gets of a body. Raises Refusal that names the field that is wrong."""
        if self.method == "GET":
            return ()
        wish = read(self.takes or Nothing, parse(body))
        return (wish,) if self.takes else ()


class Routes:
    """All routes of one interface."""

    def __init__(self) -> None:
        self._all: list[Route] = []

    def add(self, route: Route) -> None:
        """Serve one more route."""
        self._all.append(route)

    def find(self, method: str, path: str) -> tuple[Route, dict[str, str]]:
        """Return the route of a request and the parameters in its path. Raises Refusal (404), WrongMethod."""
        matching = [(one, found) for one in self._all if (found := one.parameters(path)) is not None]
        if not matching:
            raise Refusal("nothing is served at this path; /openapi.json says what is", status=404)
        for one, found in matching:
            if one.method == method:
                return one, found
        raise WrongMethod(method, (one.method for one, _ in matching))

    def openapi(self, service: str, version: str) -> dict[str, Any]:
        """Return the description of this interface, OpenAPI 3.1."""
        schemas: dict[str, Any] = {}
        refused = _content(schema(Refused, schemas, answers=True))
        paths: dict[str, Any] = {}
        for one in self._all:
            paths.setdefault(one.path, {})[one.method.lower()] = _operation(one, schemas, refused)
        token = {"type": "http", "scheme": "bearer"}
        return {
            "openapi": "3.1.0",
            "info": {"title": service, "version": version or "0"},
            "paths": paths,
            "components": {"schemas": schemas, "securitySchemes": {"token": token}},
        }


def _operation(route: Route, schemas: dict[str, Any], refused: dict[str, Any]) -> dict[str, Any]:
    said = (inspect.getdoc(route.handler) or "").partition("\n")[0]
    statuses = {"401", "403", "429", "503"}
    statuses |= {"400", "409", "411", "413", "415"} if route.method != "GET" else set()
    statuses |= {"400", "404"} if _PARAMETER.search(route.path) else set()
    told: dict[str, Any] = {
        "summary": said,
        "description": f"Needs the role {route.role.name.lower()}.",
        "security": [{}, {"token": []}],
        "responses": {"200": {"description": "done", **_content(schema(route.answers, schemas, answers=True))}}
        | {status: {"description": REFUSALS[status], **refused} for status in sorted(statuses)},
    }
    if names := _PARAMETER.findall(route.path):
        told["parameters"] = [{"name": n, "in": "path", "required": True, "schema": {"type": "string"}} for n in names]
    if route.takes is not None:
        told["requestBody"] = {"required": True, **_content(schema(route.takes, schemas))}
    return told


def _content(shape: dict[str, Any]) -> dict[str, Any]:
    return {"content": {"application/json": {"schema": shape}}}
