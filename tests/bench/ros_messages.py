"""The message definitions of the benchmark's CDR log, as ROS 2 bags carry them."""

from __future__ import annotations

HEADER = "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
TIME = "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
QUATERNION = "MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
VECTOR = "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n"
LINE = "=" * 80 + "\n"
IMU_TEXT = LINE.join(
    [
        "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
        "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
        "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance\n",
        HEADER,
        TIME,
        QUATERNION,
        VECTOR,
    ]
)
FIX_TEXT = LINE.join(
    [
        "std_msgs/Header header\nsensor_msgs/NavSatStatus status\nfloat64 latitude\nfloat64 longitude\n"
        "float64 altitude\nfloat64[9] position_covariance\nuint8 COVARIANCE_TYPE_KNOWN=3\n"
        "uint8 position_covariance_type\n",
        HEADER,
        TIME,
        "MSG: sensor_msgs/NavSatStatus\nint8 STATUS_FIX=0\nint8 status\nuint16 service\n",
    ]
)
BSM_TEXT = LINE.join(
    [
        "std_msgs/Header header\nj2735_v2x_msgs/BSMCoreData core_data\n",
        HEADER,
        TIME,
        "MSG: j2735_v2x_msgs/BSMCoreData\nuint8 msg_count\nuint8[] id\nuint16 sec_mark\nint32 latitude\n"
        "int32 longitude\nint32 elev\nPositionalAccuracy accuracy\nTransmissionState transmission\n"
        "uint16 speed\nuint16 heading\n"
        "int8 angle\nAccelerationSet4Way accel_set\nVehicleSize size\n",
        "MSG: j2735_v2x_msgs/PositionalAccuracy\nuint8 semi_major\nuint8 semi_minor\nuint16 orientation\n",
        "MSG: j2735_v2x_msgs/TransmissionState\nuint8 FORWARDGEARS=2\nuint8 transmission_state\n",
        "MSG: j2735_v2x_msgs/AccelerationSet4Way\nint16 longitudinal\nint16 lateral\nint8 vertical\nint16 yaw_rate\n",
        "MSG: j2735_v2x_msgs/VehicleSize\nuint16 vehicle_width\nuint16 vehicle_length\n",
    ]
)
IMAGE_TEXT = LINE.join(["std_msgs/Header header\nstring format\nuint8[] data\n", HEADER, TIME])
