"""Tables of separated text as programs write them that the first forty files do not show."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.unit.importing.drive import START_S, digits
from tests.unit.importing.files import KMH, KNOT, MPH
from tests.unit.importing.other_base import (
    COURSE,
    FILL,
    LAT,
    LON,
    NS,
    SLOW,
    D,
    N,
    OtherCase,
    P,
    R,
    V,
    phone_vectors,
    stamps,
    table,
)

# fmt: off

def torque(folder: Path) -> list[Path]:
    r = SLOW
    gps = stamps("%a %b %d %H:%M:%S GMT %Y", r)
    device = stamps("%d-%b-%Y %H:%M:%S.%f", r, hours=1, cut=3)
    n = len(gps)
    head = "GPS Time, Device Time, Longitude, Latitude,GPS Speed (Meters/second), Horizontal Dilution of Precision, Altitude, Bearing, G(x), G(y), G(z), G(calibrated), Engine RPM(rpm), Speed (OBD)(km/h)"
    cols = [gps, device, LON[r], LAT[r], digits(D.speed_mps[r], 3), ["4.0"] * n, ["30.0"] * n, COURSE[r], ["0.1"] * n, ["0.2"] * n, ["9.7"] * n, ["0.0"] * n, ["1500"] * n, digits(D.speed_mps[r] * KMH, 0)]
    cols[12][3] = "-"
    return table(folder, "trackLog.csv", head, cols)


def racechrono(folder: Path) -> list[Path]:
    head = """This file is created using RaceChrono v7.4.0 ( http://racechrono.com/ ).
Format,3
Session title,"Loop"
Session type,Lap timing
Track name,Loop
Driver name,
Created,14/11/2023,22:13
Note,

timestamp,fragment_id,lap_number,elapsed_time,distance_traveled,accuracy,altitude,bearing,device_update_rate,fix_type,latitude,longitude,satellites,speed,combined_acc,lateral_acc,lean_angle,longitudinal_acc
unix time,,,s,m,m,m,deg,Hz,,deg,deg,sats,m/s,G,G,deg,G
,,,,,100: gps,100: gps,100: gps,100: gps,100: gps,100: gps,100: gps,100: gps,100: gps,calc,calc,calc,calc"""
    time = [f"{START_S + t:.3f}" for t in D.t_s]
    cols = [time, ["0"] * N, [""] * N, digits(D.t_s, 3), digits(D.t_s * 10, 1), ["0.4"] * N, ["30.0"] * N, COURSE, ["10"] * N, ["3"] * N, LAT, LON, ["12"] * N, digits(D.speed_mps, 4), ["0.1"] * N, ["0.1"] * N, ["1.0"] * N, ["0.05"] * N]
    return table(folder, "session.csv", head, cols)


def airdata(folder: Path) -> list[Path]:
    ms = [str(round(t * 1000)) for t in D.t_s]
    head = "time(millisecond),datetime(utc),latitude,longitude,height_above_takeoff(feet),altitude_above_seaLevel(feet),satellites,gpslevel,speed(mph),distance(feet),mileage(feet),battery_percent,compass_heading(degrees),pitch(degrees),roll(degrees),isPhoto,flycState"
    cols = [ms, stamps("%Y-%m-%d %H:%M:%S"), LAT, LON, FILL, FILL, ["17"] * N, ["5"] * N, digits(D.speed_mps * MPH, 3), FILL, FILL, ["88"] * N, COURSE, ["0.5"] * N, ["0.1"] * N, ["0"] * N, ["P-GPS"] * N]
    return table(folder, "flight.csv", head, cols)


def german(folder: Path) -> list[Path]:
    cols = [stamps("%d.%m.%Y"), stamps("%H:%M:%S,%f", cut=3), LAT, LON, digits(D.speed_mps * KMH, 2), COURSE, ["31.0"] * N]
    head = "Datum;Uhrzeit (UTC);Breitengrad;Längengrad;Geschwindigkeit [km/h];Kurs [°];Höhe [m]"
    return table(folder, "Messfahrt.csv", head, cols, ";", decimal=",", encoding="cp1252", end="\r\n")


def french(folder: Path) -> list[Path]:
    head = "Temps (s);Latitude (°);Longitude (°);Vitesse (km/h);Cap (°);Altitude (m)"
    return table(folder, "trajet.csv", head, [digits(D.t_s, 2), LAT, LON, digits(D.speed_mps * KMH, 2), COURSE, FILL], ";", decimal=",")


def spanish(folder: Path) -> list[Path]:
    head = "Marca de tiempo (ms),Latitud,Longitud,Velocidad (km/h),Rumbo (grados)"
    ms = [str(NS // 10**6 + round(t * 1000)) for t in D.t_s]
    return table(folder, "viaje.csv", head, [ms, LAT, LON, digits(D.speed_mps * KMH, 2), COURSE])


def italian(folder: Path) -> list[Path]:
    head = "Data;Ora UTC;Latitudine;Longitudine;Velocità (km/h);Direzione (°)"
    return table(folder, "viaggio.csv", head, [stamps("%d/%m/%Y"), stamps("%H:%M:%S.%f", cut=3), LAT, LON, digits(D.speed_mps * KMH, 2), COURSE], ";", decimal=",")


def dutch(folder: Path) -> list[Path]:
    head = "tijdstempel;breedtegraad;lengtegraad;snelheid (km/u);koers"
    return table(folder, "rit.csv", head, [stamps("%Y-%m-%dT%H:%M:%S.%fZ", cut=0), LAT, LON, digits(D.speed_mps * KMH, 2), COURSE], ";")


def inca(folder: Path) -> list[Path]:
    head = "time;VehSpd_Kph;YawRt_Dps;GPS_Lat;GPS_Lon;Epm_nEng\ns;km/h;deg/s;deg;deg;rpm"
    cols = [digits(D.t_s, 3), digits(D.speed_mps * KMH, 3), digits(np.degrees(D.yaw_rate_radps), 4), LAT, LON, ["1500.0"] * N]
    return table(folder, "measure.ascii", head, cols, ";")


def gpslogger(folder: Path) -> list[Path]:
    r = SLOW
    n = len(LAT[r])
    one = ["1.0"] * n
    head = "time,lat,lon,elevation,accuracy,bearing,speed,satellites,provider,hdop,vdop,pdop,geoidheight,ageofdgpsdata,dgpsid,activity,battery,annotation"
    return table(folder, "20231114.csv", head, [stamps("%Y-%m-%dT%H:%M:%S.%fZ", r), LAT[r], LON[r], one, one, COURSE[r], digits(D.speed_mps[r], 3), ["9"] * n, ["gps"] * n, one, one, one, one, [""] * n, [""] * n, [""] * n, ["80.0"] * n, [""] * n])


def basic_airdata(folder: Path) -> list[Path]:
    r = SLOW
    n = len(LAT[r])
    head = "type,date time,latitude,longitude,accuracy(m),altitude(m),geoid_height(m),speed(m/s),bearing(deg),sat_used,sat_inview,name,desc"
    return table(folder, "20231114-track.txt", head, [["T"] * n, stamps("%Y-%m-%d %H:%M:%S", r), LAT[r], LON[r], ["3"] * n, ["30"] * n, ["45"] * n, digits(D.speed_mps[r], 3), COURSE[r], ["9"] * n, ["20"] * n, [""] * n, [""] * n])


def rostopic(folder: Path) -> list[Path]:
    ns = [str(s) for s in D.stamp_ns.tolist()]
    head = "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.status.status,field.status.service,field.latitude,field.longitude,field.altitude,field.position_covariance0"
    return table(folder, "fix.csv", head, [ns, [str(k) for k in range(N)], ns, ["gps"] * N, ["0"] * N, ["1"] * N, LAT, LON, ["30.0"] * N, ["0.1"] * N])


def plotjuggler(folder: Path) -> list[Path]:
    head = "__time,/gps/fix/latitude,/gps/fix/longitude,/vehicle/velocity_report/longitudinal_velocity,/imu/angular_velocity/x,/imu/angular_velocity/y,/imu/angular_velocity/z"
    rows = [head]
    for k in range(N):
        t = START_S + D.t_s[k]
        if k % 10 == 0:
            rows.append(f"{t:.6f},{LAT[k]},{LON[k]},,,,")
        rows.append(f"{t + 0.003:.6f},,,{np.interp(D.t_s[k] + 0.003, D.t_s, D.speed_mps):.4f},,,")
        rows.append(f"{t + 0.006:.6f},,,,0.0001,-0.0002,{np.interp(D.t_s[k] + 0.006, D.t_s, D.yaw_rate_radps):.6f}")
    (folder / "plot.csv").write_text("\n".join(rows) + "\n")
    return [folder / "plot.csv"]


def foxglove_csv(folder: Path) -> list[Path]:
    head = "topic,timestamp,header.stamp.sec,header.stamp.nsec,header.frame_id,latitude,longitude,altitude,position_covariance_type"
    sec, nsec = [str(s // 10**9) for s in D.stamp_ns.tolist()], [str(s % 10**9) for s in D.stamp_ns.tolist()]
    stamp = [f"{s / 1e9:.9f}" for s in D.stamp_ns.tolist()]
    return table(folder, "gps_fix.csv", head, [["/gps/fix"] * N, stamp, sec, nsec, ["gps"] * N, LAT, LON, ["30"] * N, ["2"] * N])


def matlab(folder: Path) -> list[Path]:
    return table(folder, "tt.csv", "Time,Lat,Lon,Speed_mps", [[f"{t:.1f} sec" for t in D.t_s], LAT, LON, digits(D.speed_mps, 4)])


def scientific(folder: Path) -> list[Path]:
    def e(v: np.ndarray) -> list[str]:
        return [f"{x:.12E}" for x in v.tolist()]

    return table(folder, "sci.csv", "utc_us,lat_rad,lon_rad,v_north,v_east", [e(D.stamp_ns / 1e3), e(np.deg2rad(D.lat_deg)), e(np.deg2rad(D.lon_deg)), e(D.speed_mps * np.sin(D.heading_rad)), e(D.speed_mps * np.cos(D.heading_rad))])


def fcd_csv(folder: Path) -> list[Path]:
    rows = ["timestep_time;vehicle_angle;vehicle_id;vehicle_lane;vehicle_pos;vehicle_slope;vehicle_speed;vehicle_type;vehicle_x;vehicle_y"]
    for k in range(N):
        rows.append(f"{D.t_s[k]:.2f};{COURSE[k]};ego;a_0;1.0;0.0;{D.speed_mps[k]:.2f};car;{D.x_m[k]:.2f};{D.y_m[k]:.2f}")
        rows.append(f"{D.t_s[k]:.2f};90.0;b;a_0;1.0;0.0;1.00;car;{D.t_s[k]:.2f};50.0")
    (folder / "fcd.csv").write_text("\n".join(rows) + "\n")
    return [folder / "fcd.csv"]


def vbo(folder: Path) -> list[Path]:
    rows = ["File created on 14/11/2023 at 22:13:20", "", "[header]", "satellites", "time", "latitude", "longitude", "velocity kmh", "heading", "height", "", "[comments]", "(c) logger", "", "[column names]", "sats time lat long velocity heading height", "", "[data]"]
    clock = stamps("%H%M%S.%f", cut=4)
    rows += [f"008 {clock[k]} {D.lat_deg[k] * 60:+012.5f} {-D.lon_deg[k] * 60:+012.5f} {D.speed_mps[k] * KMH:07.3f} {D.course_deg[k]:06.2f} +00030.00" for k in range(N)]
    (folder / "lap.vbo").write_text("\r\n".join(rows) + "\r\n")
    return [folder / "lap.vbo"]


def car_scanner(folder: Path) -> list[Path]:
    rows = ['"SECONDS";"PID";"VALUE";"UNITS";"LATITUDE";"LONGTITUDE";']
    for k in range(N):
        rows.append(f'"{80000 + D.t_s[k]:.3f}";"Vehicle speed";"{D.speed_mps[k] * KMH:.0f}";"km/h";"{LAT[k]}";"{LON[k]}";')
        rows.append(f'"{80000 + D.t_s[k] + 0.05:.3f}";"Engine RPM";"1500";"rpm";"{LAT[k]}";"{LON[k]}";')
    (folder / "scan.csv").write_text("\n".join(rows) + "\n")
    return [folder / "scan.csv"]


def dms(folder: Path) -> list[Path]:
    def text(v: float, plus: str, minus: str) -> str:
        a = abs(v)
        d, m = int(a), int(a % 1 * 60)
        return f"""{d}°{m:02d}'{(a * 60 % 1) * 60:07.4f}"{plus if v >= 0 else minus}"""

    lat = ['"' + text(v, "N", "S").replace('"', '""') + '"' for v in D.lat_deg]
    lon = ['"' + text(v, "E", "W").replace('"', '""') + '"' for v in D.lon_deg]
    return table(folder, "dms.csv", "Timestamp (UTC),Position Lat,Position Lon,SOG (kn)", [stamps("%Y-%m-%d %H:%M:%S.%f", cut=3), lat, lon, digits(D.speed_mps * KNOT, 3)])


def hemispheres(folder: Path) -> list[Path]:
    head = "date,time_utc,latitude,N/S,longitude,E/W,speed_mph"
    cols = [stamps("%Y/%m/%d"), stamps("%H:%M:%S.%f", cut=4), LAT, ["N"] * N, digits(-D.lon_deg, 8), ["W"] * N, digits(D.speed_mps * MPH, 3)]
    return table(folder, "hemi.csv", head, cols)


def highd(folder: Path) -> list[Path]:
    head = "frame,id,x,y,width,height,xVelocity,yVelocity,xAcceleration,yAcceleration"
    return table(folder, "01_tracks.csv", head, [[str(k + 1) for k in range(N)], ["1"] * N, digits(D.x_m, 2), digits(D.y_m, 2), FILL, FILL, FILL, FILL, FILL, FILL])


def unit_cells(folder: Path) -> list[Path]:
    head = "Device Time (UTC),Valid,Latitude,Longitude,Speed,Address"
    return table(folder, "traccar.csv", head, [stamps("%Y-%m-%d %H:%M:%S", SLOW), ["true"] * 90, LAT[SLOW], LON[SLOW], [f"{v * KNOT:.1f} kn" for v in D.speed_mps[SLOW]], [""] * 90])


def inertial_explorer(folder: Path) -> list[Path]:
    """Inertial Explorer: columns by blanks."""
    gps = START_S - 315_964_800 + 18
    rows = [" Week      GPSTime       Latitude      Longitude        H-Ell      Heading", "(weeks)     (sec)         (deg)         (deg)           (m)        (deg)"]
    rows += [f" {gps // 604800}  {gps % 604800 + D.t_s[k]:.3f}  {LAT[k]}  {LON[k]}  30.000  {COURSE[k]}" for k in range(N)]
    (folder / "ie.txt").write_text("\n".join(rows) + "\n")
    return [folder / "ie.txt"]


def local_time(folder: Path) -> list[Path]:
    return table(folder, "strava.csv", "Activity Date;Lat;Lng;Speed (km/h)", [stamps("%b %d, %Y, %I:%M:%S %p", SLOW), LAT[SLOW], LON[SLOW], digits(D.speed_mps[SLOW] * KMH, 1)], ";")


def us_dates(folder: Path) -> list[Path]:
    return table(folder, "fleet.csv", "Timestamp UTC,Lat,Long,MPH,Heading (deg)", [stamps("%m/%d/%Y %I:%M:%S.%f %p", SLOW), LAT[SLOW], LON[SLOW], digits(D.speed_mps[SLOW] * MPH, 2), COURSE[SLOW]])


def split_clock(folder: Path) -> list[Path]:
    parts = [stamps(each) for each in ("%Y", "%m", "%d", "%H", "%M", "%S.%f")]
    return table(folder, "parts.csv", "Year,Month,Day,Hour,Minute,Second,Lat,Lon,Speed_mps", [*parts, LAT, LON, digits(D.speed_mps, 3)])


def sec_nsec(folder: Path) -> list[Path]:
    sec, nsec = [str(s // 10**9) for s in D.stamp_ns.tolist()], [str(s % 10**9) for s in D.stamp_ns.tolist()]
    return table(folder, "ros.csv", "header.stamp.secs,header.stamp.nsecs,latitude,longitude", [sec, nsec, LAT, LON])


def excel_days(folder: Path) -> list[Path]:
    return table(folder, "days.csv", "Time;Lat;Lon", [[f"{25569 + (START_S + t) / 86400:.9f}" for t in D.t_s], LAT, LON], ";")


def minutes_seconds(folder: Path) -> list[Path]:
    return table(folder, "lap.csv", "Elapsed,Lat,Lon", [[f"{k // 60:02d}:{k % 60:02d}" for k in range(90)], LAT[SLOW], LON[SLOW]])


def trailing_commas(folder: Path) -> list[Path]:
    return table(folder, "t.csv", "time_utc,lat,lon,speed_kmh", [stamps("%Y-%m-%d %H:%M:%S.%f"), LAT, LON, digits(D.speed_mps * KMH, 3), [""] * N])


def old_mac(folder: Path) -> list[Path]:
    return table(folder, "mac.csv", "epoch_ms,lat,lon,speed_kmh", [[str(s // 10**6) for s in D.stamp_ns.tolist()], LAT, LON, digits(D.speed_mps * KMH, 3)], end="\r")


def aim(folder: Path) -> list[Path]:
    head = """"Format","AiM CSV File"
"Session","Test"
"Vehicle","Car"
"Date","Tuesday, November 14, 2023"
"Time","10:13 PM"
"Sample Rate","10"
"Duration","90.000"
"Segment","Session"

"Time","GPS Speed","GPS Nsat","GPS LatAcc","GPS LonAcc","GPS Slope","GPS Heading","GPS Gyro","GPS Altitude","GPS Latitude","GPS Longitude"
"sec","km/h","#","g","g","deg","deg","deg/s","m","deg","deg"
"""
    q = [[f'"{cell}"' for cell in column] for column in (digits(D.t_s, 3), digits(D.speed_mps * KMH, 3), ["9"] * N, digits(D.speed_mps * D.yaw_rate_radps / 9.8, 3), digits(D.accel_mps2 / 9.8, 3), FILL, COURSE, digits(-np.degrees(D.yaw_rate_radps), 3), ["31.0"] * N, LAT, LON)]
    return table(folder, "aim.csv", head, q)


def track_addict(folder: Path) -> list[Path]:
    head = "# RaceRender Data: TrackAddict 4.7.1 on Android\n# Mode: 0\n# End Point: none\nTime,UTC Time,Lap,GPS_Update,GPS_Delay,Latitude,Longitude,Altitude (m),Speed (Km/h),Heading,Accuracy (m),Accel X,Accel Y,Accel Z,Brake (calculated)"
    hold = [10 * (k // 10) for k in range(N)]
    new = ["1" if k % 10 == 0 else "0" for k in range(N)]
    cols = [
        digits(D.t_s, 3),
        [f"{START_S + t:.3f}" for t in D.t_s],
        ["0"] * N,
        new,
        ["0.0"] * N,
        [LAT[k] for k in hold],
        [LON[k] for k in hold],
        ["31.0"] * N,
        [f"{D.speed_mps[k] * KMH:.1f}" for k in hold],
        [COURSE[k] for k in hold],
        ["4.0"] * N,
        digits(D.speed_mps * D.yaw_rate_radps / 9.8, 3),
        digits(D.accel_mps2 / 9.8, 3),
        ["1.0"] * N,
        ["0"] * N,
    ]
    return table(folder, "Log-20231114.csv", head, cols)


def race_capture(folder: Path) -> list[Path]:
    head = '"Interval"|"ms"|0|0|1,"Utc"|"ms"|0|0|1,"Latitude"|"Degrees"|-180.0|180.0|10,"Longitude"|"Degrees"|-180.0|180.0|10,"Speed"|"kph"|0.0|250.0|10'
    return table(folder, "rc_0.log", head, [[str(round(t * 1000)) for t in D.t_s], [str(s // 10**6) for s in D.stamp_ns.tolist()], LAT, LON, digits(D.speed_mps * KMH, 3)])


def androsensor(folder: Path) -> list[Path]:
    force, turn = phone_vectors()
    head = "ACCELEROMETER X (m/s²);ACCELEROMETER Y (m/s²);ACCELEROMETER Z (m/s²);GYROSCOPE X (rad/s);GYROSCOPE Y (rad/s);GYROSCOPE Z (rad/s);LOCATION Latitude : ;LOCATION Longitude : ;LOCATION Altitude ( m);LOCATION Speed ( Kmh);LOCATION Accuracy ( m);LOCATION ORIENTATION (°);Time since start in ms ;YYYY-MO-DD HH-MI-SS_SSS"
    hold = [10 * (k // 10) for k in range(N)]
    cols = [
        *(digits(force[:, k], 4) for k in range(3)),
        *(digits(turn[:, k], 5) for k in range(3)),
        [LAT[k] for k in hold],
        [LON[k] for k in hold],
        ["31"] * N,
        [f"{D.speed_mps[k] * KMH:.2f}" for k in hold],
        ["3"] * N,
        [COURSE[k] for k in hold],
        [str(round(t * 1000)) for t in D.t_s],
        stamps("%Y-%m-%d %H:%M:%S:%f", hours=1, cut=3),
    ]
    return table(folder, "Sensor_record.csv", head, cols, ";")


def physics_toolbox(folder: Path) -> list[Path]:
    force, turn = phone_vectors()
    head = "time,gFx,gFy,gFz,wx,wy,wz,Latitude,Longitude,Speed (m/s),"
    clock = stamps("%H:%M:%S:%f", cut=3)
    cols = [clock, *(digits(force[:, k] / 9.80665, 4) for k in range(3)), *(digits(turn[:, k], 5) for k in range(3)), LAT, LON, digits(D.speed_mps, 3), [""] * N]
    return table(folder, "pt.csv", head, cols)


def traps(folder: Path) -> list[Path]:
    head = "Timestamp [ms],Speed Limit [km/h],Speed Accuracy [m/s],Wind Speed [m/s],Engine Speed [rpm],Lat Accel [g],Long Accel [g],Target Heading [deg],Latitude,Longitude,Ground Speed [km/h]"
    cols = [[str(s // 10**6) for s in D.stamp_ns.tolist()], ["50"] * N, ["0.3"] * N, ["3.0"] * N, ["1500"] * N, ["0.0"] * N, ["0.0"] * N, ["90.0"] * N, LAT, LON, digits(D.speed_mps * KMH, 3)]
    return table(folder, "traps.csv", head, cols)


def carmaker(folder: Path) -> list[Path]:
    head = "# Time Car.v Car.YawRate Car.Fr1.tx Car.Fr1.ty\n# s m/s rad/s m m"
    rows = [f"{D.t_s[k]:.3f} {D.speed_mps[k]:.5f} {D.yaw_rate_radps[k]:.6f} {D.x_m[k]:.4f} {D.y_m[k]:.4f}" for k in range(N)]
    (folder / "result.dat").write_text(head + "\n" + "\n".join(rows) + "\n")
    return [folder / "result.dat"]


def rtklib(folder: Path) -> list[Path]:
    head = "% program   : RTKPOST ver.2.4.3 b34\n% (lat/lon/height=WGS84/ellipsoidal,Q=1:fix,2:float)\n%  GPST                  latitude(deg) longitude(deg)  height(m)   Q  ns"
    clock = stamps("%Y/%m/%d %H:%M:%S.%f", cut=3)
    (folder / "rover.pos").write_text(head + "\n" + "\n".join(f"{clock[k]}   {LAT[k]}   {LON[k]}    31.2000   1  12" for k in range(N)) + "\n")
    return [folder / "rover.pos"]


def two_headers(folder: Path) -> list[Path]:
    cols = [stamps("%Y-%m-%dT%H:%M:%SZ", SLOW), LAT[SLOW], LON[SLOW], digits(D.speed_mps[SLOW], 3)]
    rows = list(zip(*cols, strict=True))
    head = ("time", "lat", "lon", "speed_mps")
    (folder / "twice.csv").write_text("\n".join(",".join(row) for row in [head, *rows[:45], head, *rows[45:]]) + "\n")
    return [folder / "twice.csv"]

def dji(folder: Path) -> list[Path]:
    head = "CUSTOM.date [local],CUSTOM.updateTime [local],OSD.flyTime [s],OSD.latitude,OSD.longitude,OSD.height [ft],OSD.hSpeed [MPH],OSD.yaw"
    local = (stamps("%m/%d/%Y", hours=1), stamps("%I:%M:%S.%f %p", hours=1))
    return table(folder, "flight.csv", head, [*local, digits(D.t_s, 1), LAT, LON, FILL, digits(D.speed_mps * MPH, 2), COURSE])


def micro_degrees(folder: Path) -> list[Path]:
    return table(folder, "e6.csv", "ts,latE6,lonE6", [[str(s // 1000) for s in D.stamp_ns.tolist()], digits(D.lat_deg * 1e6, 0), digits(D.lon_deg * 1e6, 0)])



def qstarz(folder: Path) -> list[Path]:
    head = "INDEX,UTC DATE,UTC TIME,LOCAL DATE,LOCAL TIME,MS,VALID,LATITUDE,N/S,LONGITUDE,E/W,SPEED,HEADING"
    utc, local = [stamps("%Y/%m/%d"), stamps("%H:%M:%S")], [stamps("%Y/%m/%d", hours=11), stamps("%H:%M:%S", hours=11)]
    ms = [str(round(t * 1000) % 1000) for t in D.t_s.tolist()]
    cols = [[str(k) for k in range(N)], *utc, *local, ms, ["SPS"] * N, LAT, ["N"] * N, digits(-D.lon_deg, 8), ["W"] * N]
    return table(folder, "qstarz.csv", head, [*cols, [f"{v * KMH:.3f} km/h" for v in D.speed_mps], COURSE])


def micro_or_tenth_micro_degrees(folder: Path) -> list[Path]:
    ms = [str(NS // 10**6 + round(t * 1000)) for t in D.t_s]
    return table(folder, "e6.csv", "time;lat;lon", [ms, digits(D.lat_deg * 1e6, 0), digits(D.lon_deg * 1e6, 0)], ";")


def _with_course(folder: Path, course: list[str], unit: float = 1.0) -> list[Path]:
    time = [f"{START_S + t:.2f}" for t in D.t_s]
    cols = [time, LAT, LON, digits(D.speed_mps * unit, 2), course]
    return table(folder, "course.csv", "unix_time,lat,lon,speed,heading", cols)


def magnetic_heading(folder: Path) -> list[Path]:
    return _with_course(folder, digits(np.mod(D.course_deg + 12.6, 360.0), 1))


def heading_without_a_value(folder: Path) -> list[Path]:
    return _with_course(folder, ["0"] * N, 1000.0)


TABLE_CASES = {
    "qstarz": OtherCase(qstarz, P | V),
    "micro-or-tenth": OtherCase(micro_or_tenth_micro_degrees, {}, asks="1e-6 degrees or 1e-7 degrees"),
    "magnetic-heading": OtherCase(magnetic_heading, {}, asks="points 13 degrees right of the way"),
    "heading-without-a-value": OtherCase(heading_without_a_value, P | R),
    "torque": OtherCase(torque, P | {"velocity": 0.3}),
    "racechrono": OtherCase(racechrono, P | V),
    "airdata": OtherCase(airdata, {"fix": 1.7, "speed": 0.3, "heading": 0.05}),
    "german": OtherCase(german, P | V),
    "french": OtherCase(french, P | V, 0),
    "spanish": OtherCase(spanish, P | V),
    "italian": OtherCase(italian, P | V),
    "dutch": OtherCase(dutch, P | V),
    "inca": OtherCase(inca, P | R | {"yaw_rate": 0.01}, 0),
    "gpslogger": OtherCase(gpslogger, P | V),
    "basic-airdata": OtherCase(basic_airdata, {}, asks="without a zone"),
    "rostopic": OtherCase(rostopic, P),
    "plotjuggler": OtherCase(plotjuggler, P | R | {"gyro": 0.01}),
    "foxglove-csv": OtherCase(foxglove_csv, P),
    "matlab": OtherCase(matlab, P | R, 0),
    "scientific": OtherCase(scientific, P | V),
    "fcd-csv": OtherCase(fcd_csv, {}, asks="names 2 vehicles"),
    "vbo": OtherCase(vbo, P | V),
    "car-scanner": OtherCase(car_scanner, P, 80_000 * 10**9),
    "dms": OtherCase(dms, P | R),
    "hemispheres": OtherCase(hemispheres, P | R),
    "highd": OtherCase(highd, {}, asks="time"),
    "unit-cells": OtherCase(unit_cells, P | R),
    "blanks": OtherCase(inertial_explorer, P | {"heading": 0.01}),
    "local-time": OtherCase(local_time, {}, asks="zone"),
    "us-dates": OtherCase(us_dates, P | V),
    "split-clock": OtherCase(split_clock, {}, asks="zone"),
    "sec-nsec": OtherCase(sec_nsec, P),
    "excel-days": OtherCase(excel_days, {}, asks="unit"),
    "minutes-seconds": OtherCase(minutes_seconds, {}, asks="minutes"),
    "trailing-commas": OtherCase(trailing_commas, P | R),
    "old-mac": OtherCase(old_mac, P | R),
    "aim": OtherCase(aim, P | V, 0),
    "track-addict": OtherCase(track_addict, P | R | {"heading": 0.05, "accel": 0.3}),
    "race-capture": OtherCase(race_capture, P | R),
    "androsensor": OtherCase(androsensor, P | R | {"gyro": 0.02, "accel": 0.3}, 0),
    "physics-toolbox": OtherCase(physics_toolbox, P | R | {"gyro": 0.02, "accel": 0.3}, (START_S % 86400) * 10**9),
    "traps": OtherCase(traps, P | R),
    "carmaker": OtherCase(carmaker, {"yaw_rate": 0.01} | R, 0),
    "rtklib": OtherCase(rtklib, P, start=NS - 18 * 10**9),
    "two-headers": OtherCase(two_headers, P | R),
    "dji": OtherCase(dji, P | R | {"heading": 0.01}, 0),
    "micro-degrees": OtherCase(micro_degrees, P),
}
