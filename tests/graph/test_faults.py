"""Services killed and stopped in a session: told on the page, healed without a hand, said by the report."""

from faulted_study import BENCH, COORDINATOR, PAGE, RECORDER, STRAP, FaultedStudy, lost, said

ONLY = (BENCH, "clock_sync", "interpreter_ecg", RECORDER, COORDINATOR, PAGE, STRAP)
STOPPED_S = 6.0


def test_killed_and_stopped_services_are_told_recovered_and_reported(start, tmp_path):
    """The page names each in a sentence, which goes when it is back; no sample is lost; the report names both.

    Who was stopped itself accuses nobody of the silence; who was killed calls no stream absent that it has not found.
    """
    (tmp_path / "recordings").mkdir()
    study = FaultedStudy(tmp_path, tmp_path / "recordings", start, ONLY)
    study.begin()
    told = [study.killed("clock_sync"), study.stopped(COORDINATOR, STOPPED_S), study.killed(COORDINATOR)]
    study.end()
    (report,) = study.reports()
    for one in told:
        assert one.service in one.sentence, one
        assert one.recovered_s is not None, one
        assert lost([report], one, ()) == 0, one
        assert said([report], one), report["events"]
    accused = {event["what"].partition(":")[0] for event in report["events"] if "no heartbeat" in event["what"]}
    assert accused <= {"clock_sync"}
    assert not [event["what"] for event in report["events"] if ": absent" in event["what"]]
