"""What lies beside a recording's messages: `metadata.yaml` of rosbag2 and `recorder.json`, as of the last flush."""

from __future__ import annotations

import time
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

from sense4hri.host_clocks import this_host
from sense4hri_recording import recorder_json, rosbag2
from sense4hri_recording.recorder_json import RecorderJson
from sense4hri_recording.rosbag2 import Channel, File

from recorder.accounts import Accounts
from recorder.split import Split
from recorder.told import About


class Description(NamedTuple):
    """Both files as they should be; metadata: content of metadata.yaml."""

    metadata: dict[str, Any]
    recorder: RecorderJson


class Described:
    """What is known of one recording for these files. Times in ns of the host's clock, 0: not yet."""

    def __init__(self, directory: Path, about: About, accounts: Accounts, opened_ns: int, distro: str) -> None:
        self._directory, self._about, self._accounts = directory, about, accounts
        self._opened_ns, self._distro = opened_ns, distro
        self.last_written_ns = self.closed_ns = 0
        self._files: list[File] = []
        self._counts: Counter[Channel] = Counter()  # of the files that are finished

    def finished(self, split: Split) -> None:
        """Add a file that nothing more is written to."""
        self._files.append(split.about())
        self._counts += split.counts

    def now(self, state: str, split: Split | None, why: str = "") -> Description:
        """Describe the recording as it is. split: the file that is being written."""
        return Description(self._metadata(split), self._recorder(state, why))

    def write(self, description: Description) -> None:
        """Write both files. Raises OSError."""
        rosbag2.write_metadata(self._directory, description.metadata)
        recorder_json.write(self._directory, description.recorder)

    def _metadata(self, split: Split | None) -> dict[str, Any]:
        files, counts = list(self._files), Counter(self._counts)
        if split is not None:
            files.append(split.about())
            counts += split.counts
        messages = {channel: counts.get(channel, 0) for channel in {**self._accounts.by_channel, **counts}}
        return rosbag2.metadata(files, messages, self._distro)

    def _recorder(self, state: str, why: str) -> RecorderJson:
        return RecorderJson(
            state,
            why,
            self._about.session,
            this_host(),
            self._opened_ns,
            self.closed_ns or None,
            self.last_written_ns,
            self._about.software,
            self._accounts.as_json(self.closed_ns or time.time_ns()),
            events=list(self._about.events),
            **self._about.surroundings(),
        )
