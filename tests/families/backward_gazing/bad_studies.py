# ruff: noqa: E501
"""Bad studies of the family, each with all that is said of it. Reviewed by eye: this is what users read."""

#: A good study, one line a block: a test replaces single lines.
LINES = {
    "family": "family: backward_gazing",
    "mode": "mode: simulated",
    "heliostat": "heliostat: {distance: 120, pixel: 0.3}",
    "target": "target: {azimuth: 0, elevation: 44}",
    "sun": "sun: {azimuth: 30, elevation: 60}",
    "cameras": "cameras: {radius: 0.24}",
    "defects": "defects: {canting: {2: [0, -1]}}",
    "profile": "sun_profile: jose",
    "erosion": "erosion: 1",
}

#: Tables that the bad studies name.
FILES = {
    "negative.csv": "angle,brightness\n0,1\n1,0.9\n2,-0.1\n3,0.8\n4.36,0.7\n",
    "flat.csv": "angle,brightness\n0,1\n1,1\n2,1\n4.36,1\n",
    "even.csv": "angle,brightness\n0,1\n1,1\n2,1\n3,0.99999\n4.36,0.99999\n",
    "spike.csv": "angle,brightness\n0,1\n1,0.9\n2,1e300\n3,0.8\n4.36,0.7\n",
    "long.csv": "angle,brightness\n0,1\n1,0." + 140_000 * "9" + "\n",
    "taken.csv": "x,y,slope_rms_x,row,camera_radius,pointing_x,module_y\n0,150,1,1,1,1,1\n",
    "head.csv": "angle,light\n0,1\n",
    "order.csv": "angle,brightness\n0.1,1\n1,x\n1,0.9\n0.5,0.8\n4.36,0.7\n",
    "near.csv": "x,y\n100,60\n0.5,0.5\n",
}
#: Lines of a field instead of one heliostat.
FIELD_LINES = LINES | {"heliostat": "heliostat: {pixel: 0.3}", "target": "target: {tilt: 30}", "sun": ""}


def _cases(text: str) -> list[tuple[str, str, list[str]]]:
    """Line of the good study that is replaced, what it becomes, and what is said, each indented in a line of its own."""
    cases: list[tuple[str, str, list[str]]] = []
    for line in text.strip().splitlines():
        if line.startswith(" "):
            cases[-1][2].append(line.strip())
        else:
            key, _, becomes = line.partition(" >")
            cases.append((key, becomes.strip().replace("\\n", "\n"), []))
    return cases


BAD = _cases("""
mode > mode: simulate
    2:7: mode: unknown choice; did you mean 'simulated'? (got 'simulate')
heliostat >
    1:1: 'heliostat.distance' is missing: Distance of the heliostat's centre from the target's; not with a field [m]
heliostat > heliostat: {distance: 0, pixel: -1}
    3:23: heliostat.distance: must be greater than 0 m (got 0)
    3:33: heliostat.pixel: must be greater than 0 m (got -1)
heliostat > heliostat: {distance: 3}
    3:23: heliostat.distance: must be more than 5.16 m, the reach of the heliostat from its centre (got 3)
heliostat > heliostat: {distance: 120, pixel: 2}
    3:35: heliostat.pixel: must be at most 1.8 m, the shorter side of module 1 (got 2)
heliostat > heliostat: {distance: 120, pixel: 0.0005}
    3:35: heliostat.pixel: is too small: 2.13e+08 pixels are more than 20,000,000 (got 0.0005)
heliostat > heliostat: {distance: 120, pixel: 1.0e-309}
    3:35: heliostat.pixel: is too small: inf pixels are more than 20,000,000 (got 1e-309)
heliostat > heliostat: {distance: 120, modules: themis}
    3:37: heliostat.modules: unknown choice; did you mean 'themis_8'? (got 'themis')
heliostat > heliostat: {distance: 120, pixel: 0.1, modules: [{centre: [0, 0], size: [2, 2]}, {centre: [1.5, 0], size: [2, 2]}]}
    3:82: heliostat.modules[1]: overlaps module 1 by 0.5 m x 2 m
heliostat > heliostat: {distance: 120, pixel: 0.1, modules: [{centre: [0], size: [2, 0]}, {center: [3, 0], size: [2, 2]}]}
    3:59: heliostat.modules[0].centre: must be two numbers [y, z] in m (got [0])
    3:74: heliostat.modules[0].size[1]: must be greater than 0 m (got 0)
    3:80: heliostat.modules[1].center: unknown key; did you mean 'centre'?
heliostat > heliostat: {distance: 120, modules: []}
    3:37: heliostat.modules: must not be empty (got [])
target > target: {azimuth: 0, elevation: 91}
    4:33: target.elevation: must be greater than -90 and less than 90 deg (got 91)
target > target: {azimuth: 0, elevation: 60, tilt: -30}
    4:33: target.elevation: the target is seen edge-on: its cameras stand in one line and cannot tell two slopes
sun >
    1:1: 'sun.azimuth' is missing: Azimuth of the sun, from south towards east; not with a field [deg]
    1:1: 'sun.elevation' is missing: Elevation of the sun; not with a field [deg]
sun > sun: {azimuth: 30, elevation: -1}
    5:31: sun.elevation: must be greater than 0 and at most 90 deg (got -1)
sun > sun: {azimuth: 30, elevation: 60, image: none.fits}
    5:42: sun.image: is only for mode: measured; remove it or change 'mode'
    5:42: sun.image: no such file, looked for relative to the study file (got 'none.fits')
cameras > cameras: {positions: [[-0.2, 0], [0, 0], [0.1, 0], [0.2, 0]]}
    6:22: cameras.positions: stand in one line: two slopes cannot be found from them
cameras > cameras: {positions: [[-0.2, 0], [0, 0.1], [0.1, 0]]}
    6:22: cameras.positions: must be a list of 4 entries [y, z] in m (got [[-0.2, 0], [0, 0.1], [0.1, 0]])
cameras > cameras: {positions: [[-0.2, 0], [-0.2, 0], [0.1, 0], [0.2, 0.3]], radius: [0.1, 0.2]}
    6:34: cameras.positions[1]: is the same as entry 0 (counted from 0); leave one out (got [-0.2, 0])
cameras > cameras: {arangement: square, threshold: 1, bits: 2.5, noise: -1}
    6:11: cameras.arangement: unknown key; did you mean 'arrangement'?
    6:42: cameras.threshold: must be greater than 0 and less than 1 (got 1)
    6:51: cameras.bits: must be a whole number (got 2.5)
    6:63: cameras.noise: must be between 0 and 1 (got -1)
defects > defects: {canting: {9: [0, 1], x: [0, 1], 02: [0, 1], 2: [1]}}
    7:58: defects.canting.2: must be two numbers [horizontal, vertical] in mrad (got [1])
defects > defects: {curvature: {2: [120, 1, 0]}}
    7:26: defects.curvature.2: focal lengths must be at least 10 m, or at most -10 m (got [120, 1, 0])
defects > defects: {curvature: {3: [120, 0]}}
    7:26: defects.curvature.3: must be three numbers [first focal length, second, axis] (got [120, 0])
defects > defects: {curvature: {9: [120, 110, 0]}}
    7:26: defects.curvature.9: no such module: the heliostat has modules 1 to 8
defects > defects: {canting: {9: [0, 1], x: [0, 1], 02: [0, 1]}}
    7:24: defects.canting.9: no such module: the heliostat has modules 1 to 8
    7:35: defects.canting.x: no such module: the heliostat has modules 1 to 8
    7:47: defects.canting.02: no such module: the heliostat has modules 1 to 8
defects > defects: {waviness: none}
    7:21: defects.waviness: must be an angle in mrad, a number or text such as '1.2 mrad' (got 'none')
profile > sun_profile: [jose, clean]
    8:21: sun_profile[1]: unknown choice; use 'jose', 'noisy' or 'table' (got 'clean')
profile > sun_profile: table
    1:1: 'sun.profile' is missing: the table that 'sun_profile: table' means
profile > sun_profile: table\\nmethod: [A, B]\\nreferential: []
    9:13: method[1]: unknown choice; use 'A', 'O1', 'O2' or 'LM' (got 'B')
    10:14: referential: the list is empty: give at least one value
profile > sun_profile: jose\\nmethod: LM\\nprofile_noise: {nodes: 2}
    10:24: profile_noise.nodes: must be between 4 and 4096 (got 2)
sun > sun: {azimuth: 30, elevation: 60, profile: none.csv}
    5:44: sun.profile: no such file, looked for relative to the study file (got 'none.csv')
sun > sun: {azimuth: 30, elevation: 60, profile: negative.csv}
    negative.csv:4: the brightness must not be negative (got -0.1)
sun > sun: {azimuth: 30, elevation: 60, profile: flat.csv}
    flat.csv: a sun profile must be darker at its edge than at its centre
sun > sun: {azimuth: 30, elevation: 60, profile: even.csv}
    even.csv: the brightness falls by only 0.001 % from the centre to the edge: no slopes follow from it; 5 % are the least
sun > sun: {azimuth: 30, elevation: 60, profile: spike.csv}
    spike.csv:4: the brightness must be relative to the disc centre, at most 1.5 (got 1e+300)
sun > sun: {azimuth: 30, elevation: 60, profile: long.csv}
    long.csv:3: holds a line of more than 100,000 letters; is this a table?
sun > sun: {azimuth: 30, elevation: 60, profile: head.csv}
    head.csv:1: needs a column brightness: relative to the disc centre
    head.csv:1:7: unknown column 'light'; remove it: the columns are angle, brightness
sun > sun: {azimuth: 30, elevation: 60, profile: order.csv}
    order.csv:2: the angles must begin with 0 (got 0.1)
    order.csv:3:3: brightness must be a finite number (got 'x')
    order.csv:5: the angles must rise (got 0.5)
erosion > erosion: 3
    9:10: erosion: leaves no pixels of 0.3 m of module 1, 1.8 m wide; lower it, or make heliostat.pixel smaller (got 3)
erosion > output: {maps: true}\\nfield: {latitude: 30, day: 81, hours: 12, layout: {file: near.csv}, receiver_height: 1, pivot_height: 0}
    3:23: heliostat.distance: follows from 'field'; remove it
    4:19: target.azimuth: follows from 'field'; remove it
    4:33: target.elevation: follows from 'field'; remove it
    5:16: sun.azimuth: follows from 'field'; remove it
    5:31: sun.elevation: follows from 'field'; remove it
    9:16: output.maps: must be false with a 'field' (got true)
erosion > output: {time_series: true}
    9:23: output.time_series: adds nothing: each instant is a point of the result already; remove it
erosion > field: {latitude: 30, day: 81, layout: {file: [near.csv]}, receiver_height: 95}
    9:1: field.hours: is missing: Solar hours, 12 is noon [h]
mode > mode: measured
    1:1: 'images' is missing: the names of four image files
    7:10: defects: is the truth of a simulation; remove it
mode > images: [near.csv, near.csv, near.csv]
    2:9: images: is only for mode: measured; remove it or change 'mode'
mode > mode: measured\\nimages: [near.csv, near.csv, near.csv]
    3:9: images: must be four images, one of each camera; these are 3
    8:10: defects: is the truth of a simulation; remove it
""")

BAD_FIELDS = _cases("""
erosion > field: {latitude: 30, day: 81, hours: 12, layout: {file: taken.csv}, receiver_height: 95}
    taken.csv:1:5: column name 'slope_rms_x' is taken by the result; choose another
    taken.csv:1:21: column name 'camera_radius' is taken by the result; choose another
    taken.csv:1:35: column name 'pointing_x' is taken by the result; choose another
    taken.csv:1:46: column name 'module_y' is taken by the result; choose another
erosion > field: {latitude: 30, day: 81, hours: 12, layout: {file: near.csv}, receiver_height: 1, pivot_height: 0}
    9:51: field.layout: heliostat 1 (line 3) reaches to the target, 1.22 m away
erosion > field: {latitude: 30, day: 81, hours: 12, layout: {radial_stagger: {clearance: [13, 14], inner_radius: 50, rings: 2}}, receiver_height: 95}
    9:51: field.layout: cannot be swept here
""")
