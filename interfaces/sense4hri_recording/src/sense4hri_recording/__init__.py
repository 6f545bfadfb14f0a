"""The recording format: how a recording lies on the disk, and how it is read, repaired and described.

No ROS and no pandas. Whoever writes, plays, reports on, exports or changes a recording does it through this package:

`layout`         names of folders and files, and the files of a recording in their order
`recorder_json`  what only the recorder knows, versioned
`parts`          which folders are one session
`rosbag2`        `metadata.yaml`
`reader`         the messages of whole files; `source`: also of damaged ones
`chunks`         what is in a file, bounded before it is believed; `definitions`: what its types must be
`repair`         a readable copy of a file that was cut off
`lock`, `files`  one writer at a time; files written whole or not at all
`cdr`            stamps and samples straight from a message's bytes
"""
