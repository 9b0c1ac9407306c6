"""The names of the leaf fields that hold a message's time."""

HEADER_STAMP_FIELDS = ("header.stamp.sec", "header.stamp.nanosec")
"""The leaf fields of a ROS 2 header's time; those of JSON and ROS 1 bridges (`secs`, `nsecs`, `nsec`) are in
`JSON_STAMP_FIELDS`."""
JSON_STAMP_FIELDS = (
    "header.stamp.secs",
    "header.stamp.nsecs",
    "header.stamp.nsec",
    "timestamp",
    "timestamp.sec",
    "timestamp.nsec",
    "timestamp.nanosec",
)
"""The further leaf fields of a time in JSON messages."""
PROTOBUF_STAMP_FIELDS = ("timestamp.seconds", "timestamp.nanos")
"""The leaf fields of a time in foxglove's protobuf messages."""
CDR_FOXGLOVE_STAMP_FIELDS = ("timestamp.sec", "timestamp.nanosec")
"""The leaf fields of a time in `foxglove_msgs`."""
