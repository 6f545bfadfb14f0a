"""Writes Grafana's dashboards, `dashboards/*.json`, from the lists below.

    .venv/bin/python compose/grafana/make_dashboards.py

The JSON is written by Grafana's own Foundation SDK. A test compares the files with what this writes, and every name in
a query with docs/metrics.md. Colours are traffic lights: red, data are being lost; yellow, look at it.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from grafana_foundation_sdk.builders import common, statetimeline, table, timeseries
from grafana_foundation_sdk.builders import dashboard as build
from grafana_foundation_sdk.builders import prometheus as query
from grafana_foundation_sdk.cog.encoder import JSONEncoder
from grafana_foundation_sdk.models import dashboard as model
from grafana_foundation_sdk.models.prometheus import PromQueryFormat

FOLDER = Path(__file__).parent / "dashboards"
SOURCE = model.DataSourceRef(type_val="prometheus", uid="prometheus")
WIDTH = 24
HEIGHT = 8
STREAM = "sensor_type, sensor_id"
CHOSEN = 'sensor_type="$sensor_type", sensor_id="$sensor_id"'
TAKES = "sense4hri_update_duration_seconds"
REFUSED = "sense4hri_refused_messages_total"
STATES = (("starting", "blue"), ("connecting", "yellow"), ("streaming", "green"), ("lost", "red"), ("stopping", "blue"))
PAIR = "{{host}} − {{field}}"
CLOCK_STATES = (("warm-up", "yellow"), ("locked", "green"), ("hold-over", "red"))
NO_YES = (("no", "red"), ("yes", "green"))
PHASES = (("idle", "blue"), ("preparing", "yellow"), ("recording", "green"), ("stopping", "blue"), ("failed", "red"))
Steps = Sequence[tuple[float | None, str]]
"""From which value on which colour; the first from below everything."""
GOOD_HIGH: Steps = ((None, "red"), (0.5, "yellow"), (0.7, "green"))


class Column(NamedTuple):
    """One column of a table with a row for each stream. by: the labels that its query keeps."""

    title: str
    expression: str
    unit: str = "short"
    steps: Steps = ((None, "green"),)
    states: Sequence[tuple[str, str]] = ()


class Curve(NamedTuple):
    """One panel over time."""

    title: str
    expression: str
    legend: str
    unit: str = "short"
    steps: Steps = ((None, "green"),)
    states: Sequence[tuple[str, str]] = ()
    width: int = 12


def each_stream(metric: str) -> str:
    """The value of each stream; of several processes that export it, the highest."""
    return f"max by ({STREAM}) ({metric})"


def of_sensor(metric: str) -> str:
    """A value of each sensor, beside each of its streams."""
    return (
        f"max by ({STREAM}) (0 * sense4hri_stream_state + on (sensor_id) group_left () max by (sensor_id) ({metric}))"
    )


def on_hosts(metric: str) -> str:
    """A value with its host, which compose/host_override.py names; on one machine, and in Kubernetes, nobody does."""
    return f'label_replace({metric}, "host", "unnamed", "host", "")'


STREAMS = (
    Column("state", each_stream("sense4hri_stream_state"), states=STATES),
    Column(
        "rate",
        each_stream("sense4hri:sampling_frequency:ratio"),
        "percentunit",
        ((None, "red"), (0.9, "yellow"), (0.97, "green"), (1.1, "yellow")),
    ),
    Column(
        "lost in 5 min", each_stream("increase(sense4hri_lost_samples_total[5m])"), steps=((None, "green"), (1, "red"))
    ),
    Column("quality", each_stream("sense4hri_signal_quality_ratio"), "percentunit", GOOD_HIGH),
    Column(
        "latency p99",
        each_stream("sense4hri:latency_seconds:p99"),
        "s",
        ((None, "green"), (0.05, "yellow"), (0.1, "red")),
    ),
    Column("clock", of_sensor("sense4hri_clock_state"), states=CLOCK_STATES),
    Column(
        "clock ±",
        of_sensor("sense4hri_clock_uncertainty_seconds"),
        "s",
        ((None, "green"), (0.01, "yellow"), (0.05, "red")),
    ),
    Column(
        "battery",
        of_sensor("sense4hri_battery_ratio"),
        "percentunit",
        ((None, "red"), (0.2, "yellow"), (0.4, "green")),
    ),
    Column("signal", of_sensor("sense4hri_rssi_dbm"), "dBm", ((None, "red"), (-90, "yellow"), (-80, "green"))),
    Column("contact", of_sensor("sense4hri_contact_ratio"), "percentunit", GOOD_HIGH),
    Column("reconnects", of_sensor("sense4hri_reconnects_total"), steps=((None, "green"), (1, "yellow"))),
)

CURVES: dict[str, Sequence[Curve]] = {
    "study": (
        Curve("session", "sense4hri_session_phase", "session", states=PHASES, width=8),
        Curve("firing", 'count by (alertname) (ALERTS{alertstate="firing"}) or vector(0)', "{{alertname}}", width=8),
        Curve("disk lasts", "sense4hri_recorder_left_seconds", "until full", "s", width=8),
    ),
    "stream": (
        Curve("state", f"sense4hri_stream_state{{{CHOSEN}}}", "state", states=STATES, width=24),
        Curve("rate", f"sense4hri_sampling_frequency_hertz{{{CHOSEN}}}", "measured", "hertz"),
        Curve("lost", f"rate(sense4hri_lost_samples_total{{{CHOSEN}}}[30s])", "samples per second"),
        Curve("gaps", f"increase(sense4hri_gaps_total{{{CHOSEN}}}[1m])", "within a minute"),
        Curve("came twice", f"increase(sense4hri_duplicates_total{{{CHOSEN}}}[1m])", "frames within a minute"),
        Curve("signal quality", f"sense4hri_signal_quality_ratio{{{CHOSEN}}}", "{{service}}", "percentunit"),
        Curve("receipt to publication", f"sense4hri:latency_seconds:p99{{{CHOSEN}}}", "p99", "s"),
        Curve("delay of the link", f"sense4hri_link_delay_seconds{{{CHOSEN}}}", "beyond the smallest", "s"),
        Curve("radio signal", 'sense4hri_rssi_dbm{sensor_id="$sensor_id"}', "received", "dBm"),
        Curve("battery", 'sense4hri_battery_ratio{sensor_id="$sensor_id"}', "charge", "percentunit"),
        Curve("contact", 'sense4hri_contact_ratio{sensor_id="$sensor_id"}', "contact", "percentunit"),
        Curve(
            "undecodable", 'increase(sense4hri_undecodable_frames_total{sensor_id="$sensor_id"}[1m])', "within a minute"
        ),
    ),
    "clocks": (
        Curve("state", "sense4hri_clock_state", "{{sensor_id}}", states=CLOCK_STATES, width=24),
        Curve("uncertainty, 95 %", "sense4hri_clock_uncertainty_seconds", "{{sensor_id}}", "s"),
        Curve("rate against this host", "1e6 * sense4hri_clock_skew_ratio", "{{sensor_id}} ppm"),
        Curve("delay of the newest packets", "sense4hri_clock_latency_seconds", "{{sensor_id}}", "s"),
        Curve("epochs of the clock", "sense4hri_clock_segment", "{{sensor_id}}"),
        Curve("offset: change in 1 min", "delta(sense4hri_clock_offset_seconds[1m])", "{{sensor_id}}", "s", width=24),
        Curve("hosts: state", on_hosts("sense4hri_host_clock_state"), PAIR, states=CLOCK_STATES, width=24),
        Curve("hosts: offset", on_hosts("sense4hri_host_clock_offset_seconds"), PAIR, "s"),
        Curve("hosts: uncertainty, 95 %", on_hosts("sense4hri_host_clock_uncertainty_seconds"), PAIR, "s"),
        Curve("hosts: rate", on_hosts("1e6 * sense4hri_host_clock_skew_ratio"), f"{PAIR} ppm"),
        Curve("hosts: smallest round trip", on_hosts("sense4hri_host_clock_round_trip_seconds"), PAIR, "s"),
    ),
    "services": (
        Curve("ready", "min by (service) (sense4hri_ready)", "{{service}}", states=NO_YES, width=24),
        Curve("CPU", "sum by (service) (sense4hri:cpu:ratio)", "{{service}}", "percentunit"),
        Curve("memory", "sum by (service) (sense4hri:resident_memory:bytes)", "{{service}}", "bytes"),
        Curve("busy", "max by (service) (sense4hri:busy:ratio)", "{{service}}", "percentunit"),
        Curve("waiting", "max by (service) (sense4hri_waiting_calls)", "{{service}}"),
        Curve("dropped", "sum by (service) (increase(sense4hri_dropped_messages_total[1m]))", "{{service}}"),
        Curve("refused", f"sum by (service) (increase({REFUSED}[1m])) or vector(0)", "{{service}}"),
        Curve(
            "features: one message takes",
            f"rate({TAKES}_sum[1m]) / rate({TAKES}_count[1m])",
            "{{sensor_type}} {{sensor_id}}",
            "s",
        ),
        Curve("recorder: written", "rate(sense4hri_recorder_written_bytes[30s])", "payload", "Bps"),
        Curve("recorder: behind", "sense4hri_recorder_behind_seconds", "study's own messages", "s"),
        Curve("recorder: lost", "sense4hri_recorder_lost_messages", "messages of this recording"),
        Curve("recorder: since the last sync", "time() - sense4hri_recorder_last_sync_timestamp_seconds", "age", "s"),
        Curve("processes", "sense4hri:processes:count", "{{service}}"),
        Curve("hosts: processes that are ready", f"sum by (host) ({on_hosts('sense4hri_ready')})", "{{host}}"),
        Curve("hosts: CPU", f"sum by (host) ({on_hosts('sense4hri:cpu:ratio')})", "{{host}}", "percentunit"),
        Curve("hosts: memory", f"sum by (host) ({on_hosts('sense4hri:resident_memory:bytes')})", "{{host}}", "bytes"),
        Curve(
            "hosts: busiest service", f"max by (host) ({on_hosts('sense4hri:busy:ratio')})", "{{host}}", "percentunit"
        ),
    ),
}
TITLES = {
    "study": "Sense4HRI: study",
    "stream": "Sense4HRI: one stream",
    "clocks": "Sense4HRI: clocks",
    "services": "Sense4HRI: services and hosts",
}


def mapping(states: Sequence[tuple[str, str]]) -> list[Any]:
    """Words and colours for the numbers 0, 1, 2, ..."""
    options = {
        str(number): model.ValueMappingResult(text=text, color=colour, index=number)
        for number, (text, colour) in enumerate(states)
    }
    return [model.ValueMap(options=options)]


def thresholds(steps: Steps) -> build.ThresholdsConfig:
    """Colours by value."""
    chosen = [model.Threshold(value=value, color=colour) for value, colour in steps]
    return build.ThresholdsConfig().mode(model.ThresholdsMode.ABSOLUTE).steps(chosen)


def look(each: Column) -> list[model.DynamicConfigValue]:
    """How a column is shown: coloured by its value or its state."""
    steps: dict[str, Any] = {"mode": "absolute", "steps": [{"value": value, "color": to} for value, to in each.steps]}
    found: dict[str, Any] = {
        "unit": each.unit,
        "custom.cellOptions": {"type": "color-background", "mode": "basic"},
        "thresholds": steps,
        "decimals": 0 if each.unit in ("short", "percentunit", "dBm") else 1,
    }
    if each.states:
        found["mappings"] = mapping(each.states)
    return [model.DynamicConfigValue(id_val=name, value=value) for name, value in found.items()]


def streams_table() -> table.Panel:
    """One row for each stream."""
    panel = table.Panel().title("streams").datasource(SOURCE).span(WIDTH).height(2 * HEIGHT).no_value("–")
    for number, each in enumerate(STREAMS):
        letter = chr(ord("A") + number)
        target = query.Dataquery().ref_id(letter).expr(each.expression).instant()
        panel = panel.with_target(target.format(PromQueryFormat.TABLE))
        panel = panel.override_by_name(each.title, look(each))
    names = {f"Value #{chr(ord('A') + number)}": each.title for number, each in enumerate(STREAMS)}
    organize = {"excludeByName": {"Time": True}, "renameByName": names}
    panel = panel.with_transformation(model.DataTransformerConfig(id_val="merge", options={}))
    return panel.with_transformation(model.DataTransformerConfig(id_val="organize", options=organize))


def curve(each: Curve) -> timeseries.Panel | statetimeline.Panel:
    """One panel over time: states as a band, numbers as lines."""
    panel: Any = statetimeline.Panel().mappings(mapping(each.states)) if each.states else timeseries.Panel()
    target = query.Dataquery().ref_id("A").expr(each.expression).legend_format(each.legend).range()
    panel = panel.title(each.title).datasource(SOURCE).span(each.width).height(HEIGHT).unit(each.unit)
    if not each.states:
        panel = panel.legend(common.VizLegendOptions().show_legend(True))
    return panel.thresholds(thresholds(each.steps)).with_target(target)


def queries() -> list[str]:
    """Every query of every panel."""
    return [each.expression for each in STREAMS] + [each.expression for curves in CURVES.values() for each in curves]


def variable(name: str, asked: str) -> build.QueryVariable:
    """A choice at the top of a dashboard."""
    return build.QueryVariable(name).datasource(SOURCE).query(asked)


def made(name: str) -> model.Dashboard:
    """One dashboard."""
    board = build.Dashboard(TITLES[name]).uid(f"sense4hri-{name}").tags(["sense4hri"]).readonly()
    board = board.refresh("5s").time("now-10m", "now").timezone("browser")
    if name == "stream":
        board = board.with_variable(variable("sensor_id", "label_values(sense4hri_stream_state, sensor_id)"))
        asked = 'label_values(sense4hri_stream_state{sensor_id="$sensor_id"}, sensor_type)'
        board = board.with_variable(variable("sensor_type", asked))
    if name == "study":
        board = board.with_panel(streams_table())
    for each in CURVES[name]:
        board = board.with_panel(curve(each))
    return board.build()


def files() -> dict[Path, str]:
    """What is to stand in which file."""
    return {
        FOLDER / f"{name}.json": json.dumps(made(name), cls=JSONEncoder, indent=2, sort_keys=True, ensure_ascii=False)
        + "\n"
        for name in TITLES
    }


def main() -> int:
    """Write them all."""
    FOLDER.mkdir(exist_ok=True)
    for path, text in files().items():
        path.write_text(text)
        print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
