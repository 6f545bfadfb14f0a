"""Only reports below the recordings are served, whatever is asked for."""

import os

import pytest
from web_gui.reports import Reports


@pytest.fixture
def recordings(tmp_path):
    """A recorded session with a report, and things beside it that are nobody's business."""
    root = tmp_path / "recordings"
    folder = root / "demo" / "p1-p2" / "s 1"
    folder.mkdir(parents=True)
    (folder / "report.html").write_text("<h1>complete</h1>")
    (folder / "s1_0.mcap").write_text("data of a participant")
    (tmp_path / "report.html").write_text("outside")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "report.html").write_text("outside")
    (root / "link").symlink_to(tmp_path / "elsewhere")
    (root / "linked").mkdir()
    (root / "linked" / "report.html").symlink_to(folder / "s1_0.mcap")
    (root / "folder" / "report.html").mkdir(parents=True)
    (root / "pipe").mkdir()
    os.mkfifo(root / "pipe" / "report.html")
    return root


def test_a_report_has_an_address_and_is_read_by_it(recordings):
    """The address is quoted, the content is the file's."""
    reports = Reports(str(recordings))
    path = recordings / "demo" / "p1-p2" / "s 1" / "report.html"
    assert reports.address(str(path)) == "/reports/demo/p1-p2/s%201/report.html"
    with reports.open("demo/p1-p2/s 1/report.html") as file:
        assert file.read() == b"<h1>complete</h1>"


@pytest.mark.parametrize(
    "path",
    [
        "",
        "report.html",
        "../report.html",
        "demo/../../report.html",
        "demo//p1-p2/s 1/report.html",
        "./demo/p1-p2/s 1/report.html",
        "/demo/p1-p2/s 1/report.html",
        "demo/p1-p2/s 1/s1_0.mcap",
        "demo/p1-p2/s 1",
        "demo/p1-p2/s 1/report.html/",
        "demo/p1-p2/s 1/report.html\0",
        "demo\0/report.html",
        "link/report.html",
        "link/../report.html",
        "linked/report.html",
        "folder/report.html",
        "pipe/report.html",
        "none/report.html",
        "a" * 300 + "/report.html",
    ],
)
def test_anything_else_is_refused(recordings, path):
    """Traversal, symbolic links, folders, pipes and other files are no reports."""
    reports = Reports(str(recordings))
    with pytest.raises((ValueError, OSError)):
        reports.open(path)


def test_a_path_outside_has_no_address(recordings, tmp_path):
    """Also where the recorder itself names it."""
    reports = Reports(str(recordings))
    for path in ("../report.html", "link/report.html", "linked/report.html", "demo/p1-p2/s 1/s1_0.mcap"):
        assert reports.address(str(recordings / path)) == ""
    assert reports.address(str(tmp_path / "report.html")) == ""
    assert reports.address("relative/report.html") == ""


def test_without_a_directory_nothing_is_served(tmp_path, monkeypatch):
    """An empty parameter does not mean the working directory."""
    (tmp_path / "report.html").write_text("x")
    monkeypatch.chdir(tmp_path)
    reports = Reports("")
    assert reports.address(str(tmp_path / "report.html")) == ""
    with pytest.raises(ValueError, match="not a report"):
        reports.open("report.html")
