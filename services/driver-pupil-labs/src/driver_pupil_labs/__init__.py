"""Eye trackers of Pupil Labs: Core over its network API, Neon and Invisible over their real-time API."""
