# ruff: noqa: E501
"""Bad studies of the family, each with all that is said of it. Reviewed by eye: this is what users read."""

#: A good study, one line a block: a test replaces single lines.
LINES = {
    "family": "family: misalignment",
    "mode": "mode: curves",
    "site": "site: {latitude: 37.4}",
    "time": "time: {clock: solar, days: [172], hours: [8, 12, 16]}",
    "receiver": "receiver: {height: 143, width: 9, height_extent: 9}",
    "heliostats": "heliostats: {positions: [[-16, 150, 0], [-60, 300, 0]]}",
    "mount": "mount: {mirror_offset: 0.5}",
    "error": "error: {source: [canting, encoder], axis: [elevation, azimuth], size: {start: -12, stop: 12, step: 1}}",
}
DRAWN = "mount_errors: {azimuth_reference: {normal: [0, 1.5]}, samples: 10, seed: 7}"

NOT_DRAWN = "is for errors that are drawn, and none is: remove it, or draw one, such as {normal: [0, 1]}"

#: Line that is replaced, what it becomes, what is said.
BAD: list[tuple[str, str, list[str]]] = [
    ("mode", "mode: curve", ["2:7: mode: unknown choice; did you mean 'curves'? (got 'curve')"]),
    ("site", "", ["1:1: give 'site' or 'sites': the sun depends on the latitude"]),
    ("time", "", ["1:1: give 'time', with days and hours, or 'sun', with azimuth and elevation"]),
    (
        "time",
        "time: {clock: solar, hours: 12}\nsun: {azimuth: 101, elevation: 50}",
        ["5:6: sun: give 'time' or 'sun', not both"],
    ),
    (
        "time",
        "sun: {azimuth: 400, elevation: 0}",
        [
            "4:16: sun.azimuth: must be between -360 and 360 deg (got 400)",
            "4:32: sun.elevation: must be greater than 0 and at most 90 deg (got 0)",
        ],
    ),
    (
        "time",
        "time: {clock: solar, hours: [0, 1]}",
        ["4:29: time.hours: the sun never rises at these latitudes, days and hours"],
    ),
    (
        "time",
        "time: {clock: civil, dates: 2024-06-21, window: {start: '08:00', stop: '16:00', step: 1}}",
        [
            "3:1: site.longitude: is missing: the civil clock needs the longitude, in deg east",
            "4:1: time.timezone: is missing: the civil clock needs a time zone, such as '+08:00'",
        ],
    ),
    (
        "heliostats",
        "heliostats: {positions: [[1, 2], [1, 2, .nan], [1, 2, 3], [1, 2, 3.0], x, [1, 2, 3 deg]]}",
        [
            "6:26: heliostats.positions[0]: must be three numbers [x, y, z] in m (got [1, 2])",
            "6:41: heliostats.positions[1][2]: must be a finite number (got nan)",
            "6:59: heliostats.positions[3]: is the same as entry 2 (counted from 0); leave one out (got [1, 2, 3.0])",
            "6:72: heliostats.positions[4]: must be three numbers [x, y, z] in m (got 'x')",
            "6:82: heliostats.positions[5][2]: must be a length in m, a number or text such as '1.5 m'; "
            "'deg' is the unit of an angle (got '3 deg')",
        ],
    ),
    (
        "heliostats",
        "heliostats: {positions: []}",
        ["6:25: heliostats.positions: the list is empty: give at least one entry [x, y, z] in m"],
    ),
    (
        "heliostats",
        "heliostats: {positions: 3}",
        ["6:25: heliostats.positions: must be a list of entries [x, y, z] in m (got 3)"],
    ),
    (
        "heliostats",
        "heliostats: {pivot_height: 3}",
        ["1:1: give 'heliostats: {positions: [[x, y, z], ...]}' or a 'layout'"],
    ),
    (
        "heliostats",
        "heliostats: {positions: [[-16, 150, 0]], pivot_height: 3}",
        [
            "6:56: heliostats.pivot_height: positions are those of the pivots; remove this key, or give a 'layout' "
            "instead of positions"
        ],
    ),
    (
        "heliostats",
        "heliostats: {positions: [[-16, 150, 0]]}\nlayout: {radial_stagger: {clearance: 16, inner_radius: 60, rings: 4}}",
        ["6:25: heliostats.positions: give 'positions' or a 'layout', not both"],
    ),
    (
        "heliostats",
        "heliostats: {pivot_height: 3}\nlayout: {file: none.csv}",
        ["7:16: layout.file: no such file, looked for relative to the study file (got 'none.csv')"],
    ),
    (
        "mount",
        "mount: {kind: alt, mirror_offset: -1}",
        [
            "7:15: mount.kind: unknown choice; use 'azimuth_elevation', 'target_aligned', 'polar' or 'tilt_roll' "
            "(got 'alt')",
            "7:35: mount.mirror_offset: must be at least 0 m (got -1)",
        ],
    ),
    (
        "mount",
        "mount: {axis_offset: [0, 1]}",
        [
            "7:22: mount.axis_offset: must be 0 in mode: curves, whose mounts have both axes through the pivot "
            "(got [0, 1])"
        ],
    ),
    (
        "time",
        "time: {clock: solar, days: [355, 80, 172], hours: {start: 16, stop: 8, step: -1}}",
        ["4:28: time.days: must rise", "4:51: time.hours: must rise"],
    ),
    ("time", "time: {clock: solar, declination: [10, 0], hours: 12}", ["4:35: time.declination: must rise"]),
    (
        "mount",
        "mount: {axis_azimuth: [0, 90]}",
        ["7:23: mount.axis_azimuth: is only for 'kind: tilt_roll', which is not among the mounts (got [0, 90])"],
    ),
    (
        "mount",
        "mount: {mirror_offset: 300}",
        [
            "7:24: mount.mirror_offset: must be smaller than the distance from heliostat 0 to the aim point, 207.858 m "
            "(got 300)"
        ],
    ),
    ("error", "", ["1:1: 'error' is missing: {source, axis, size}, the misalignment whose curves are traced"]),
    (
        "error",
        "error: {source: cant, axis: elev, size: 3 m}",
        [
            "8:17: error.source: unknown choice; did you mean 'canting'? (got 'cant')",
            "8:29: error.axis: unknown choice; did you mean 'elevation'? (got 'elev')",
            "8:41: error.size: must be an angle in mrad, a number or text such as '1.2 mrad'; 'm' is the unit of a "
            "length (got '3 m')",
        ],
    ),
    (
        "error",
        "error: {size: 1}\ndetectors: {lines: [[0, 0, 1], [1, 0, 6], [1, 0, 6]]}",
        [
            "9:21: detectors.lines[0]: is no line: its first two numbers must not both be zero (got [0, 0, 1])",
            "9:43: detectors.lines[2]: is the same as entry 1 (counted from 0); leave one out (got [1, 0, 6])",
        ],
    ),
    (
        "error",
        f"error: {{size: 1}}\n{DRAWN}\nstatistics: {{percentiles: 50}}\ncalibration: {{parameters: 4}}",
        [
            "9:15: mount_errors: draws are for other modes: in mode: curves give numbers or sweeps",
            "10:13: statistics: is only for mode: mount_errors; remove it or change 'mode'",
            "11:14: calibration: is only for mode: calibration; remove it or change 'mode'",
        ],
    ),
    (
        "mode",
        "mode: mount_errors",
        [
            "1:1: 'mount_errors' is missing: which errors the mounts have, such as 'azimuth_reference', "
            "'elevation_reference', 'tilt_about_east', 'tilt_about_north', 'non_orthogonality' or 'collimation', in mrad",
            "8:8: error: is only for mode: curves; remove it or change 'mode'",
        ],
    ),
]

#: Mode, what stands in place of the line of `error`, what is said.
BAD_MOUNTS: list[tuple[str, str, list[str]]] = [
    (
        "mount_errors",
        "mount_errors: {azimuth_reference: {normal: [0, -1]}, samples: 0, scale: -1}",
        [
            "8:48: mount_errors.azimuth_reference.normal[1]: the standard deviation must not be negative (got -1)",
            "8:63: mount_errors.samples: must be between 1 and 1e+09 (got 0)",
            "8:73: mount_errors.scale: must be at least 0 (got -1)",
        ],
    ),
    (
        "mount_errors",
        "mount_errors: {azimuth_reference: {normal: [0, 1]}}",
        ["8:15: mount_errors: 'samples' is missing: how many times the distributions are drawn"],
    ),
    (
        "mount_errors",
        "mount_errors: {samples: 10, collimation: {uniform: [0, 1], samples: 11}}",
        ["8:69: mount_errors.collimation.samples: must be 10, as all errors are drawn equally often (got 11)"],
    ),
    (
        "mount_errors",
        "mount_errors: {azimuth_reference: {normal: [0, 1e6]}, collimation: {lognormal: [0, 1]}, samples: 3}",
        [
            "8:48: mount_errors.azimuth_reference.normal[1]: the standard deviation must be at most 500 mrad (got 1000000.0)",
            "8:80: mount_errors.collimation.lognormal: unknown distribution; a distribution is "
            "{normal: [mean, standard deviation]} or {uniform: [low, high]}",
        ],
    ),
    (
        "mount_errors",
        "mount_errors: {}",
        [
            "8:15: mount_errors: names no error: give 'azimuth_reference', 'elevation_reference', 'tilt_about_east', "
            "'tilt_about_north', 'non_orthogonality' or 'collimation', in mrad"
        ],
    ),
    (
        "mount_errors",
        "mount_errors: {azimuth_reference: 1, scale: [1, 2], samples: 9}",
        ["8:45: mount_errors.scale: " + NOT_DRAWN, "8:62: mount_errors.samples: " + NOT_DRAWN],
    ),
    (
        "mount_errors",
        "mount_errors: {azimuth_reference: [1, 2], seed: 9}\nstatistics: {percentiles: [5, 95]}",
        ["8:49: mount_errors.seed: " + NOT_DRAWN, "9:13: statistics: " + NOT_DRAWN],
    ),
    (
        "calibration",
        "mount_errors: {azimuth_reference: 1}\ncalibration: {parameters: [2, 3], days_used: 2, loss: hubr, noise: -1}",
        [
            "9:31: calibration.parameters[1]: must be 2, 4 or 6 (got 3)",
            "9:55: calibration.loss: unknown choice; did you mean 'huber'? (got 'hubr')",
            "9:68: calibration.noise: must be at least 0 m (got -1)",
        ],
    ),
    (
        "calibration",
        "mount_errors: {azimuth_reference: 1}\ncalibration: {days_used: [1, 2]}",
        ["9:26: calibration.days_used: must be at most 1, the number of days of 'time' (got 2)"],
    ),
    (
        "mount_errors",
        "mount_errors: {azimuth_reference: 1}\noutput: {time_series: true}",
        ["9:23: output.time_series: adds nothing: each instant is a point of the result already; remove it"],
    ),
    (
        "calibration",
        "calibration: {spots: none.csv}",
        ["8:22: calibration.spots: no such file, looked for relative to the study file (got 'none.csv')"],
    ),
]
