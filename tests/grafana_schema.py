"""Grafana's model of a dashboard as a JSON Schema, made from the types of its Foundation SDK.

The SDK is generated from Grafana's own schemas, but its `from_json` takes anything. What its types say is all in here:
the keys, which of them must be there, the type of every value, and the options of each kind of panel.
"""

from __future__ import annotations

import inspect
import types
import typing
from enum import Enum
from functools import cache
from typing import Any

from grafana_foundation_sdk.cog import plugins, variants
from grafana_foundation_sdk.cog.runtime import PanelCfgConfig, Runtime
from grafana_foundation_sdk.models import dashboard, prometheus
from jsonschema import Draft202012Validator
from jsonschema.exceptions import best_match

Schema = dict[str, Any]
LEAVES: dict[object, Schema] = {
    str: {"type": "string"},
    bool: {"type": "boolean"},
    int: {"type": "integer"},
    float: {"type": "number"},
    types.NoneType: {"type": "null"},
    object: {},
    dashboard.Dashboard: {"$ref": "#"},  # a snapshot has one
}


class Given(str):
    """What stands for the value of an argument, by its name."""


def faults(board: object) -> list[str]:
    """Return where a dashboard is not as the model, and why; nothing where it is."""
    found = Draft202012Validator(fields(dashboard.Dashboard)).iter_errors(board)
    return [f"{nearest.json_path}: {nearest.message}" for error in found if (nearest := best_match([error]))]


@cache
def of(hint: Any) -> Schema:
    """Return the schema of a type. Queries are those of Prometheus: the dashboards have no other source."""
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if hint in LEAVES:
        return LEAVES[hint]
    if origin is typing.Literal:
        return {"enum": [*inner]}
    if origin is list:
        return {"type": "array", "items": of(inner[0])}
    if origin is dict:
        return {"type": "object", "additionalProperties": of(inner[1])}
    if {*inner} == {dashboard.Panel, dashboard.RowPanel}:
        return by("type", kinds() | {"row": fields(dashboard.RowPanel)})
    if origin is typing.Union:
        return {"anyOf": [of(one) for one in inner]}
    if issubclass(hint, Enum):
        return {"enum": [one.value for one in hint]}
    if hint is variants.Dataquery:
        return of(prometheus.Dataquery)
    return by("type", kinds()) if hint is dashboard.Panel else fields(hint)


def fields(model: Any, **known: Schema) -> Schema:
    """Return the schema of an object: a key that is written of an empty one too must be there. known: by key."""
    hints = typing.get_type_hints(model)
    written = model(**{name: Given(name) for name in inspect.signature(model).parameters}).to_json()
    needed = model().to_json()

    def value(key: str, stands: object) -> Schema:
        if not isinstance(stands, Given):
            return {"const": stands}
        schema = of(hints[stands])
        return schema if key in needed else _there(schema)

    properties = {key: known.get(key) or value(key, stands) for key, stands in written.items()}
    return {"type": "object", "properties": properties, "required": [*needed], "additionalProperties": False}


def _there(schema: Schema) -> Schema:
    """Return the schema less null: a key without a value is left out."""
    ways = [one for one in schema.get("anyOf", ()) if one != LEAVES[types.NoneType]]
    return {"anyOf": ways} if len(ways) > 1 else next(iter(ways), schema)


def by(key: str, schemas: dict[str, Schema]) -> Schema:
    """Return the schema of what the value of a key tells apart."""
    cases = [{"if": {"properties": {key: {"const": one}}}, "then": schema} for one, schema in schemas.items()]
    return {"required": [key], "properties": {key: {"enum": [*schemas]}}, "allOf": cases}


@cache
def kinds() -> dict[str, Schema]:
    """Return the schema of each kind of panel that Grafana brings."""
    plugins.register_default_plugins()
    return {kind: _panel(config) for kind, config in Runtime().panelcfg_variants.items()}


def _panel(config: PanelCfgConfig) -> Schema:
    options, custom = _model(config.options_from_json_hook), _model(config.field_config_from_json_hook)
    return fields(dashboard.Panel, options=of(options), fieldConfig=_field_config(custom))


def _model(from_json: Any) -> Any:
    return object if from_json is None else from_json.__self__


def _field_config(custom: Any) -> Schema:
    """Return the schema of how values are shown; what an override changes is of the type that it has elsewhere."""
    defaults = fields(dashboard.FieldConfig, custom=of(custom))
    own = of(custom).get("properties", {})
    shown = defaults["properties"] | {f"custom.{key}": value for key, value in own.items()}
    values = by("id", {key: {"properties": {"value": value}} for key, value in shown.items()})
    change = {"allOf": [of(dashboard.DynamicConfigValue), values]}
    override = fields(dashboard.DashboardFieldConfigSourceOverrides, properties={"type": "array", "items": change})
    return fields(dashboard.FieldConfigSource, defaults=defaults, overrides={"type": "array", "items": override})
