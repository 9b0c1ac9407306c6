"""Names of the leaf fields that hold a message's time."""

HEADER_STAMP = ("header.stamp.sec", "header.stamp.nanosec")
"""ROS 2 names; the JSON ones of ROS 1 bridges (`secs`, `nsecs`, `nsec`) are in `JSON_STAMPS`."""
JSON_STAMPS = (
    "header.stamp.secs",
    "header.stamp.nsecs",
    "header.stamp.nsec",
    "timestamp",
    "timestamp.sec",
    "timestamp.nsec",
    "timestamp.nanosec",
)
PROTOBUF_STAMP = ("timestamp.seconds", "timestamp.nanos")
CDR_FOXGLOVE_STAMP = ("timestamp.sec", "timestamp.nanosec")
