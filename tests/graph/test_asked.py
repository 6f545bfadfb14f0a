"""What rules and dashboards ask, asked of a real Prometheus that scrapes a running demo with a second host."""

import asked
import metrics_table
import pytest
import study_file
from monitoring import Monitoring
from processes import poll
from sense4hri.host_clocks import this_host

SENSOR, KIND = "h10_2", "ecg"


@pytest.mark.timeout(600)
def test_every_rule_panel_and_choice_finds_something(bin_folder, demo, start, tmp_path):
    """Also what is there only with a second host: its clock-sync runs here beside the demo's."""
    watch = Monitoring(tmp_path, bin_folder)
    try:
        run = demo("--duration", "120")
        run.until("records, into", 120)
        other = start("clock_sync", host="other", reference_host=this_host())
        watch.watch([*metrics_table.ports(run.logs), other.port()])
        queries = asked.everything(SENSOR, KIND)
        poll(
            lambda: not asked.unanswered(queries, watch.query),
            lambda: f"nothing for {asked.unanswered(queries, watch.query)}",
            90,
            0.5,
        )
        sensors, kinds = (watch.answer(path) for path in asked.of_choices(SENSOR))
        assert set(sensors) == {service.sensor_id for service in study_file.read(study_file.find("demo")).sensors}
        assert KIND in kinds
    finally:
        watch.close()
