# ruff: noqa: E501
"""Bad studies, each with all that is said of it. Reviewed by eye: this is what users read."""

#: Line that is replaced (or "file" for the whole text), what it becomes, what is said.
BAD_STUDIES: list[tuple[str, str, list[str]]] = [
    (
        "site",
        "site: {latitude: 91}",
        [
            "study.yaml:2:18: site.latitude: must be between -90 and 90 deg (got 91)",
        ],
    ),
    (
        "site",
        "site: {latitude: -90.5}",
        [
            "study.yaml:2:18: site.latitude: must be between -90 and 90 deg (got -90.5)",
        ],
    ),
    (
        "site",
        "site: {latitude: true}",
        [
            "study.yaml:2:18: site.latitude: must be an angle in deg, a number or text such as '30 deg' (got true)",
        ],
    ),
    (
        "site",
        "site: {latitude: abc}",
        [
            "study.yaml:2:18: site.latitude: must be an angle in deg, a number or text such as '30 deg' (got 'abc')",
        ],
    ),
    (
        "site",
        "site: {latitude: '12'}",
        [
            "study.yaml:2:18: site.latitude: must be a number without quotes, or a number with its unit (got '12')",
        ],
    ),
    (
        "site",
        "site: {latitude: 3 m}",
        [
            "study.yaml:2:18: site.latitude: must be an angle in deg, a number or text such as '30 deg'; 'm' is the unit of a length (got '3 m')",
        ],
    ),
    (
        "site",
        "site: {latitude: 3 dge}",
        [
            "study.yaml:2:18: site.latitude: unknown unit 'dge'; did you mean 'deg'? (got '3 dge')",
        ],
    ),
    (
        "site",
        "site: {latitude: 12:30}",
        [
            "study.yaml:2:18: site.latitude: must be an angle in deg, a number or text such as '30 deg' (got '12:30')",
        ],
    ),
    (
        "site",
        "site: {latitude: 1_000}",
        [
            "study.yaml:2:18: site.latitude: must be an angle in deg, a number or text such as '30 deg' (got '1_000')",
        ],
    ),
    (
        "site",
        "site: {latitude: .nan}",
        [
            "study.yaml:2:18: site.latitude: must be a finite number (got nan)",
        ],
    ),
    (
        "site",
        "site: {latitude: -.inf}",
        [
            "study.yaml:2:18: site.latitude: must be a finite number (got -inf)",
        ],
    ),
    (
        "site",
        "site: {latitude: 1e400}",
        [
            "study.yaml:2:18: site.latitude: must be a finite number (got inf)",
        ],
    ),
    (
        "site",
        "site: {latitude: ~}",
        [
            "study.yaml:2:18: site.latitude: nothing is given; write a value or remove the key",
        ],
    ),
    (
        "site",
        "site: {latitude: []}",
        [
            "study.yaml:2:18: site.latitude: the list is empty: give at least one value",
        ],
    ),
    (
        "site",
        "site: {latitude: [1, 1.0]}",
        [
            "study.yaml:2:22: site.latitude[1]: the same value stands in the list twice (got 1.0)",
        ],
    ),
    (
        "site",
        "site: {latitude: [1, [2]]}",
        [
            "study.yaml:2:22: site.latitude[1]: must be an angle in deg, a number or text such as '30 deg' (got [2])",
        ],
    ),
    (
        "site",
        "site: {latitude: [-91, x]}",
        [
            "study.yaml:2:24: site.latitude[1]: must be an angle in deg, a number or text such as '30 deg' (got 'x')",
        ],
    ),
    (
        "site",
        "site: {latitude: {}}",
        [
            "study.yaml:2:18: site.latitude: 'start' and 'stop' are missing: a range is {start, stop, step}, {start, stop, num} or {logspace: {start, stop, num}}",
        ],
    ),
    (
        "site",
        "site: {latitude: {start: 0, stop: 90}}",
        [
            "study.yaml:2:18: site.latitude: a range needs 'step' or 'num' beside 'start' and 'stop'",
        ],
    ),
    (
        "site",
        "site: {latitude: {start: 0, step: 5}}",
        [
            "study.yaml:2:18: site.latitude: 'stop' is missing: a range is {start, stop, step}, {start, stop, num} or {logspace: {start, stop, num}}",
        ],
    ),
    (
        "site",
        "site: {latitude: {strat: 1, stop: 2, num: 3}}",
        [
            "study.yaml:2:26: site.latitude.strat: unknown key; did you mean 'start'?",
        ],
    ),
    (
        "site",
        "site: {latitude: {start: 1, stop: 2, num: 3, base: 10}}",
        [
            "study.yaml:2:52: site.latitude.base: unknown key",
        ],
    ),
    (
        "site",
        "site: {latitude: {start: 0, stop: 90, step: 1, num: 3}}",
        [
            "study.yaml:2:53: site.latitude.num: give 'step' or 'num', not both",
        ],
    ),
    (
        "site",
        "site: {latitude: {start: 0, stop: 90, step: 0}}",
        [
            "study.yaml:2:45: site.latitude.step: must not be zero (got 0)",
        ],
    ),
    (
        "site",
        "site: {latitude: {start: 0, stop: 90, step: -1}}",
        [
            "study.yaml:2:45: site.latitude.step: has the wrong sign: from 0 to 90 it must be positive (got -1)",
        ],
    ),
    (
        "site",
        "site: {latitude: {start: 9, stop: 0, step: 1}}",
        [
            "study.yaml:2:44: site.latitude.step: has the wrong sign: from 9 to 0 it must be negative (got 1)",
        ],
    ),
    (
        "site",
        "site: {latitude: {start: 0, stop: 90, step: 1 m}}",
        [
            "study.yaml:2:45: site.latitude.step: must be an angle in deg, a number or text such as '30 deg'; 'm' is the unit of a length (got '1 m')",
        ],
    ),
    (
        "site",
        "site: {latitude: {start: -100, stop: 100, step: 1}}",
        [
            "study.yaml:2:26: site.latitude.start: must be between -90 and 90 deg (got -100)",
            "study.yaml:2:38: site.latitude.stop: must be between -90 and 90 deg (got 100)",
        ],
    ),
    (
        "site",
        "site: {latitude: {start: 0, stop: 90, num: 0}}",
        [
            "study.yaml:2:44: site.latitude.num: must be between 1 and 1e+15 (got 0)",
        ],
    ),
    (
        "site",
        "site: {latitude: {start: 0, stop: 90, num: 1}}",
        [
            "study.yaml:2:44: site.latitude.num: must be at least 2 where start and stop differ (got 1)",
        ],
    ),
    (
        "site",
        "site: {latitude: {start: 0, stop: 90, num: 2.5}}",
        [
            "study.yaml:2:44: site.latitude.num: must be a whole number (got 2.5)",
        ],
    ),
    (
        "site",
        "site: {latitude: {start: 0, stop: 0, num: 3}}",
        [
            "study.yaml:2:35: site.latitude.stop: must differ from start where there is more than one value (got 0)",
        ],
    ),
    (
        "site",
        "site: {latitude: {start: 0, stop: 1, step: 1e-16}}",
        [
            "study.yaml:2:44: site.latitude.step: gives more than 1e+15 values; is the step too small? (got 1e-16)",
        ],
    ),
    (
        "site",
        "site: {latitude: {start: 1, stop: 1.000000000000001, num: 100}}",
        [
            "study.yaml:2:59: site.latitude.num: the steps are finer than the precision of numbers (got 100)",
        ],
    ),
    (
        "site",
        "site: {latitude: {start: x, stop: y, step: z}}",
        [
            "study.yaml:2:26: site.latitude.start: must be an angle in deg, a number or text such as '30 deg' (got 'x')",
            "study.yaml:2:35: site.latitude.stop: must be an angle in deg, a number or text such as '30 deg' (got 'y')",
            "study.yaml:2:44: site.latitude.step: must be an angle in deg, a number or text such as '30 deg' (got 'z')",
        ],
    ),
    (
        "site",
        "site: {latitude: {logspace: {start: 0, stop: 5, num: 3}}}",
        [
            "study.yaml:2:37: site.latitude.logspace.start: must not be zero (got 0)",
        ],
    ),
    (
        "site",
        "site: {latitude: {logspace: {start: 1, stop: -5, num: 3}}}",
        [
            "study.yaml:2:46: site.latitude.logspace.stop: must have the sign of start (got -5)",
        ],
    ),
    (
        "site",
        "site: {latitude: {logspace: [1, 2]}}",
        [
            "study.yaml:2:29: site.latitude.logspace: must be a mapping {start, stop, num} (got [1, 2])",
        ],
    ),
    (
        "site",
        "site: {latitude: {logspace: {start: 1, stop: 100, num: 3}}}",
        [
            "study.yaml:2:46: site.latitude.logspace.stop: must be between -90 and 90 deg (got 100)",
        ],
    ),
    (
        "site",
        "site: {latitude: {logspace: {start: 1, stop: 10}, step: 2}}",
        [
            "study.yaml:2:18: site.latitude: 'logspace' cannot be mixed with other keys",
        ],
    ),
    (
        "site",
        "site: {latitude: {logspace: {start: 1, stop: 10}}}",
        [
            "study.yaml:2:29: site.latitude.logspace: 'num' is missing: it is {start, stop, num}",
        ],
    ),
    (
        "site",
        "site:",
        [
            "study.yaml:2:6: site: nothing is given; write a value or remove the key",
        ],
    ),
    (
        "site",
        "site: 30",
        [
            "study.yaml:2:7: site: must be a mapping of keys to values (got 30)",
        ],
    ),
    (
        "site",
        "site: [30]",
        [
            "study.yaml:2:7: site: must be a mapping of keys to values (got [30])",
        ],
    ),
    (
        "site",
        "site: {}",
        [
            "study.yaml:2:1: site.latitude: is missing: Geographic latitude, positive north [deg]",
        ],
    ),
    (
        "site",
        "site: {lattitude: 30}",
        [
            "study.yaml:2:8: site.lattitude: unknown key; did you mean 'latitude'?",
        ],
    ),
    (
        "site",
        "site: {latitude: 30, latitude: 31}",
        [
            "study.yaml:2:22: site.latitude: duplicate key (first on line 2)",
        ],
    ),
    (
        "site",
        "site: {latitude: 30, timezone: Asia/Shangai}",
        [
            "study.yaml:2:32: site.timezone: unknown time zone; did you mean 'Asia/Shanghai'? (got 'Asia/Shangai')",
        ],
    ),
    (
        "site",
        "site: {latitude: 30, longitude: 181}",
        [
            "study.yaml:2:33: site.longitude: must be between -180 and 180 deg (got 181)",
        ],
    ),
    (
        "site",
        "",
        [
            "study.yaml:1:1: give 'site' or 'sites'",
        ],
    ),
    (
        "site",
        "site: {latitude: 3}\nsites: [{name: a, latitude: 3}]",
        [
            "study.yaml:3:8: sites: give 'site' or 'sites', not both",
        ],
    ),
    (
        "site",
        "sites: 3",
        [
            "study.yaml:2:8: sites: must be a list of named sites or {file: NAME.csv} (got 3)",
        ],
    ),
    (
        "site",
        "sites: []",
        [
            "study.yaml:2:8: sites: must not be empty (got [])",
        ],
    ),
    (
        "site",
        "sites: [3, {name: 3, latitude: 91, x: 2}]",
        [
            "study.yaml:2:9: sites[0]: must be a mapping of keys to values (got 3)",
            "study.yaml:2:19: sites[1].name: must be text; write it in quotes (got 3)",
            "study.yaml:2:32: sites[1].latitude: must be between -90 and 90 deg (got 91)",
            "study.yaml:2:36: sites[1].x: unknown key",
        ],
    ),
    (
        "site",
        "sites: {file: missing.csv}",
        [
            "study.yaml:2:15: sites.file: no such file, looked for relative to the study file (got 'missing.csv')",
        ],
    ),
    (
        "site",
        "sites: {fiel: a.csv}",
        [
            "study.yaml:2:9: sites.fiel: unknown key; did you mean 'file'?",
        ],
    ),
    (
        "site",
        "sites: [{name: a, latitude: [1, 2]}]",
        [
            "study.yaml:2:29: sites[0].latitude: must be a single value; it cannot be swept (got [1, 2])",
        ],
    ),
    (
        "tracking",
        "tracking: []",
        [
            "study.yaml:3:11: tracking: the list is empty: give at least one value",
        ],
    ),
    (
        "tracking",
        "tracking: {a: 1}",
        [
            "study.yaml:3:11: tracking: must be 'spinning_elevation' or 'azimuth_elevation' (got a mapping)",
        ],
    ),
    (
        "tracking",
        "tracking: spinning",
        [
            "study.yaml:3:11: tracking: unknown choice; did you mean 'spinning_elevation'? (got 'spinning')",
        ],
    ),
    (
        "tracking",
        "tracking: [azimuth_elevation, azimuth_elevatoin]",
        [
            "study.yaml:3:31: tracking[1]: unknown choice; did you mean 'azimuth_elevation'? (got 'azimuth_elevatoin')",
        ],
    ),
    (
        "tracking",
        "trakcing: spinning_elevation",
        [
            "study.yaml:3:1: trakcing: unknown key; did you mean 'tracking'?",
        ],
    ),
    (
        "tracking",
        "tracking: 3",
        [
            "study.yaml:3:11: tracking: must be 'spinning_elevation' or 'azimuth_elevation' (got 3)",
        ],
    ),
    (
        "time",
        "time: {clock: lunar}",
        [
            "study.yaml:4:15: time.clock: must be 'solar', 'civil' or 'sun' (got 'lunar')",
        ],
    ),
    (
        "time",
        "time: {hours: 3}",
        [
            "study.yaml:4:1: time.clock: is missing: 'solar', 'civil' or 'sun'",
        ],
    ),
    (
        "time",
        "time: 5",
        [
            "study.yaml:4:7: time: must be a mapping of keys to values (got 5)",
        ],
    ),
    (
        "time",
        "time:",
        [
            "study.yaml:4:6: time: nothing is given; write a value or remove the key",
        ],
    ),
    (
        "time",
        "time: {clock: solar}",
        [
            "study.yaml:4:1: time.hours: is missing: Solar hours of each day, 12 = noon [h]",
        ],
    ),
    (
        "time",
        "time: {clock: solar, hours: 25}",
        [
            "study.yaml:4:29: time.hours: must be between 0 and 24 h (got 25)",
        ],
    ),
    (
        "time",
        "time: {clock: solar, hours: {start: 8, stop: 16, step: -0.2}}",
        [
            "study.yaml:4:56: time.hours.step: has the wrong sign: from 8 to 16 it must be positive (got -0.2)",
        ],
    ),
    (
        "time",
        "time: {clock: solar, hours: [8], sampling: midpoint}",
        [
            "study.yaml:4:29: time.hours: must be a range {start, stop, step} for the sampling 'midpoint'",
        ],
    ),
    (
        "time",
        "time: {clock: solar, hours: {start: 8, stop: 16, step: 0.3}, sampling: left}",
        [
            "study.yaml:4:56: time.hours.step: must divide the window into whole steps for the sampling 'left' (got 0.3)",
        ],
    ),
    (
        "time",
        "time: {clock: solar, hours: 12, sampling: middle}",
        [
            "study.yaml:4:43: time.sampling: unknown choice; use 'inclusive', 'left' or 'midpoint' (got 'middle')",
        ],
    ),
    (
        "time",
        "time: {clock: solar, hours: 12, days: 366}",
        [
            "study.yaml:4:39: time.days: must be between 1 and 365 (got 366)",
        ],
    ),
    (
        "time",
        "time: {clock: solar, hours: 12, days: 1.5}",
        [
            "study.yaml:4:39: time.days: must be a whole number (got 1.5)",
        ],
    ),
    (
        "time",
        "time: {clock: solar, hours: 12, days: {start: 1, stop: 3, num: 4}}",
        [
            "study.yaml:4:39: time.days: the values of the range must be whole numbers",
        ],
    ),
    (
        "time",
        "time: {clock: solar, hours: 12, days: 1, declination: 3}",
        [
            "study.yaml:4:55: time.declination: give 'days' or 'declination', not both",
        ],
    ),
    (
        "time",
        "time: {clock: solar, hours: {start: 0, stop: 3, step: 1}}",
        [
            "study.yaml:4:29: time.hours: the sun never rises at these latitudes, days and hours",
        ],
    ),
    (
        "time",
        "time: {clock: solar, hours: 12, hour: 3}",
        [
            "study.yaml:4:33: time.hour: unknown key; did you mean 'hours'?",
        ],
    ),
    (
        "time",
        "time: {clock: civil, dates: 2021-02-29, window: {start: '07:00', stop: '06:00', step: 30 min}}",
        [
            "study.yaml:4:29: time.dates: is not a date of the calendar (got '2021-02-29')",
            "study.yaml:4:72: time.window.stop: must be after the start, 07:00 (got '06:00')",
        ],
    ),
    (
        "time",
        "time: {clock: civil, dates: {start: 2021-01-05, stop: 2021-01-01}, window: {start: 7, stop: '25:00', step: 30 m}}",
        [
            "study.yaml:4:55: time.dates.stop: must not be before the start, 2021-01-05 (got '2021-01-01')",
            "study.yaml:4:84: time.window.start: must be a time of day such as '07:00' (got 7)",
            "study.yaml:4:93: time.window.stop: must be a time of day between '00:00' and '24:00' (got '25:00')",
            "study.yaml:4:108: time.window.step: must be a duration in h, a number or text such as '1.5 h'; 'm' is the unit of a length (got '30 m')",
        ],
    ),
    (
        "time",
        "time: {clock: civil, dates: {start: 2021-01-05, stpo: 2021-01-06}, window: {start: 07:00, stop: 08:00, step: 2 h}, timezone: 8}",
        [
            "study.yaml:4:55: time.dates.stpo: unknown key; did you mean 'stop'?",
            "study.yaml:4:110: time.window.step: must not be longer than the window (got '2 h')",
            "study.yaml:4:126: time.timezone: must be an offset such as '+08:00' or a name such as 'Asia/Shanghai', in quotes (got 8)",
        ],
    ),
    (
        "time",
        "time: {clock: civil, dates: [], window: 3, timezone: +8}",
        [
            "study.yaml:4:29: time.dates: the list is empty: give at least one value",
            "study.yaml:4:41: time.window: must be a mapping of keys to values (got 3)",
            "study.yaml:4:54: time.timezone: must be an offset such as '+08:00' or a name such as 'Asia/Shanghai', in quotes (got 8)",
        ],
    ),
    (
        "time",
        "time: {clock: civil, dates: 2021-01-05, window: {start: 07:00, stop: 08:00, step: 7 min}, sampling: midpoint}",
        [
            "study.yaml:4:83: time.window.step: must divide the window into whole steps for the sampling 'midpoint' (got '7 min')",
        ],
    ),
    (
        "layout",
        "layout: {}",
        [
            "study.yaml:5:9: layout: give exactly one of 'file' and 'radial_stagger'",
        ],
    ),
    (
        "layout",
        "layout: x.csv",
        [
            "study.yaml:5:9: layout: must be a mapping of keys to values (got 'x.csv')",
        ],
    ),
    (
        "layout",
        "layout: {file: missing.csv}",
        [
            "study.yaml:5:16: layout.file: no such file, looked for relative to the study file (got 'missing.csv')",
        ],
    ),
    (
        "layout",
        "layout: {file: [missing.csv, gone.csv]}",
        [
            "study.yaml:5:17: layout.file[0]: no such file, looked for relative to the study file (got 'missing.csv')",
            "study.yaml:5:30: layout.file[1]: no such file, looked for relative to the study file (got 'gone.csv')",
        ],
    ),
    (
        "layout",
        "layout: {file: [a.csv, a.csv]}",
        [
            "study.yaml:5:17: layout.file[0]: no such file, looked for relative to the study file (got 'a.csv')",
            "study.yaml:5:24: layout.file[1]: the same value stands in the list twice (got 'a.csv')",
            "study.yaml:5:24: layout.file[1]: no such file, looked for relative to the study file (got 'a.csv')",
        ],
    ),
    (
        "layout",
        "layout: {file: ''}",
        [
            "study.yaml:5:16: layout.file: must be the name of a file, relative to the study file (got '')",
        ],
    ),
    (
        "layout",
        "layout: {radial_stagger: {clearance: 3, rings: 3, heliostats: 5}}",
        [
            "study.yaml:5:26: layout.radial_stagger: 'inner_radius' is missing: the radius of the first ring, in m",
            "study.yaml:5:63: layout.radial_stagger.heliostats: give exactly one of 'rings', 'heliostats' and 'zones'",
        ],
    ),
    (
        "layout",
        "layout: {radial_stagger: {clearance: 3, inner_radius: 4, rings: 2.5}}",
        [
            "study.yaml:5:65: layout.radial_stagger.rings: must be a whole number (got 2.5)",
        ],
    ),
    (
        "layout",
        "layout: {radial_stagger: {clearance: 3, inner_radius: 4, zones: [{start: 3}]}}",
        [
            "study.yaml:5:58: layout.radial_stagger.zones[0].rings: is missing: Number of rings",
        ],
    ),
    (
        "heliostat",
        "heliostat: {width: 0, height: -1, pivot_height: x}",
        [
            "study.yaml:6:20: heliostat.width: must be greater than 0 m (got 0)",
            "study.yaml:6:31: heliostat.height: must be greater than 0 m (got -1)",
            "study.yaml:6:49: heliostat.pivot_height: must be a length in m, a number or text such as '1.5 m' (got 'x')",
        ],
    ),
    (
        "heliostat",
        "heliostat: {height: [1, 2], width: 1, pivot_height: 0}\nreceiver: {hieght: 1}",
        [
            "study.yaml:7:12: receiver.hieght: unknown key; did you mean 'height'?",
            "study.yaml:8:1: receiver: duplicate key (first on line 7)",
        ],
    ),
    (
        "receiver",
        "receiver: {height: 0}",
        [
            "study.yaml:7:20: receiver.height: must be greater than 0 m (got 0)",
        ],
    ),
    (
        "receiver",
        "receiver: {height: [95]}\nzip: 3",
        [
            "study.yaml:8:6: zip: must be a list (got 3)",
        ],
    ),
    (
        "receiver",
        "receiver: {height: 95}\nzip: [[site.latitude, tracking]]",
        [
            "study.yaml:8:8: zip[0][0]: is not a swept key; list swept keys, such as site.latitude (got 'site.latitude')",
            "study.yaml:8:23: zip[0][1]: is not a swept key; list swept keys, such as site.latitude (got 'tracking')",
        ],
    ),
    (
        "receiver",
        "receiver: {height: [95, 96]}\nzip: [[receiver.height]]",
        [
            "study.yaml:8:7: zip[0]: must name at least two swept keys to tie together",
        ],
    ),
    (
        "receiver",
        "receiver: {height: [95, 96]}\nzip: [[receiver_height, receiver.height]]",
        [
            "study.yaml:8:25: zip[0][1]: is tied twice (got 'receiver.height')",
        ],
    ),
    (
        "family",
        "",
        [
            "study.yaml:1:1: family: is missing: 'field_efficiency'",
        ],
    ),
    (
        "family",
        "family: 3",
        [
            "study.yaml:1:9: family: must be 'field_efficiency' (got 3)",
        ],
    ),
    (
        "family",
        "family: field_eficiency",
        [
            "study.yaml:1:9: family: unknown family; did you mean 'field_efficiency'? (got 'field_eficiency')",
        ],
    ),
    (
        "family",
        "family: optics",
        [
            "study.yaml:1:9: family: unknown family; use 'field_efficiency' (got 'optics')",
        ],
    ),
    (
        "family",
        "family: ~",
        [
            "study.yaml:1:9: family: nothing is given; write a value or remove the key",
        ],
    ),
    (
        "family",
        "title: x\nfamily: field_efficiency\ntitle: y",
        [
            "study.yaml:3:1: title: duplicate key (first on line 1)",
        ],
    ),
    (
        "family",
        "family: field_efficiency\ntitle: 5",
        [
            "study.yaml:2:8: title: must be text; write it in quotes (got 5)",
        ],
    ),
    (
        "family",
        "family: field_efficiency\nexecution: {scheduler: dask, workers: no, memory: 2 Gb, chunks: {latitude: 0.5}}",
        [
            "study.yaml:2:24: execution.scheduler: unknown choice; use 'threads', 'processes', 'synchronous', 'distributed', "
            "'slurm', 'pbs', 'sge', 'lsf', 'htcondor', 'oar', 'local-jobs' or 'tcp://HOST:PORT' (got 'dask')",
            "study.yaml:2:39: execution.workers: must be a number (got 'no')",
            "study.yaml:2:51: execution.memory: unknown unit 'Gb'; did you mean 'GB'? (got '2 Gb')",
            "study.yaml:2:76: execution.chunks.latitude: must be at least 1 (got 0.5)",
        ],
    ),
    (
        "family",
        "family: field_efficiency\noutput: {time_series: yes, compression: gzip, compression_level: 10}",
        [
            "study.yaml:2:23: output.time_series: must be true or false (got 'yes')",
            "study.yaml:2:41: output.compression: unknown choice; use 'none', 'zlib' or 'zstd' (got 'gzip')",
            "study.yaml:2:66: output.compression_level: must be between 1 and 9 (got 10)",
        ],
    ),
    (
        "family",
        "family: field_efficiency\nreport: {published: {file: missing.csv}}",
        [
            "study.yaml:2:10: report.published.source: is missing: Where they were published",
            "study.yaml:2:28: report.published.file: no such file, looked for relative to the study file (got 'missing.csv')",
        ],
    ),
    (
        "family",
        "family: field_efficiency\nreferences: x",
        [
            "study.yaml:2:13: references: must be a list (got 'x')",
        ],
    ),
    (
        "family",
        "family: field_efficiency\nfavourite: x",
        [
            "study.yaml:2:1: favourite: unknown key",
        ],
    ),
    (
        "file",
        "family: &a field_efficiency",
        [
            "study.yaml:1:9: family: anchors (&) and aliases (*) are not allowed; write the value out",
        ],
    ),
    (
        "file",
        "&a family: field_efficiency",
        [
            "study.yaml:1:1: anchors (&) and aliases (*) are not allowed; write the value out",
        ],
    ),
    (
        "file",
        "a: 1\nb: *a",
        [
            "study.yaml:2:4: b: anchors (&) and aliases (*) are not allowed; write the value out",
        ],
    ),
    (
        "file",
        "family: !!python/object:os.system x",
        [
            "study.yaml:1:9: family: tags are not allowed (got tag:yaml.org,2002:python/object:os.system); write the plain value",
        ],
    ),
    (
        "file",
        "!!map {a: 1}",
        [
            "study.yaml:1:1: tags are not allowed (got tag:yaml.org,2002:map); write the plain value",
        ],
    ),
    (
        "file",
        "family: 'field_efficiency",
        [
            "study.yaml:2:1: not valid YAML: found unexpected end of stream",
        ],
    ),
    (
        "file",
        "family: [a",
        [
            "study.yaml:2:1: not valid YAML: did not find expected ',' or ']'",
        ],
    ),
    (
        "file",
        "family: a\n---\nb: 3",
        [
            "study.yaml:2:1: only one study per file: remove the second document ('---')",
        ],
    ),
    (
        "file",
        "- a",
        [
            "study.yaml:1:1: a study is a mapping of keys to values, such as 'family: ...'",
        ],
    ),
    (
        "file",
        "\tfamily: x",
        [
            "study.yaml:1:1: not valid YAML: tabs cannot indent; use spaces",
        ],
    ),
    (
        "file",
        "? [a]\n: 3",
        [
            "study.yaml:1:3: a key must be plain text",
        ],
    ),
    (
        "file",
        "title: \x07",
        [
            "study.yaml:1:8: character U+0007 is not allowed",
        ],
    ),
    (
        "file",
        "x: [[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]",
        [
            "study.yaml:1:53: nested more than 50 levels deep",
        ],
    ),
    (
        "file",
        "",
        [
            "study.yaml:1:1: the file is empty; a study starts with 'family: ...'",
        ],
    ),
    (
        "file",
        "# nothing",
        [
            "study.yaml:1:1: the file is empty; a study starts with 'family: ...'",
        ],
    ),
    (
        "file",
        "a: 1\n b: 2",
        [
            "study.yaml:2:3: not valid YAML: mapping values are not allowed in this context",
        ],
    ),
    (
        "file",
        "just text",
        [
            "study.yaml:1:1: a study is a mapping of keys to values, such as 'family: ...'",
        ],
    ),
    (
        "site",
        "sites: [{name: a, latitude: 3}, {name: b, latitude: 4}, {name: a, latitude: 5}]",
        [
            "study.yaml:2:64: sites[2].name: another site has this name (got 'a')",
        ],
    ),
    (
        "time",
        "time: {clock: civil, timezone: UTC, dates: [1699-12-31, 9999-12-31], window: {start: 10:00, stop: 14:00, step: 1}}",
        [
            "study.yaml:4:45: time.dates[0]: must be a date of the years 1700 to 2200 (got '1699-12-31')",
            "study.yaml:4:57: time.dates[1]: must be a date of the years 1700 to 2200 (got '9999-12-31')",
        ],
    ),
    (
        "time",
        "time: {clock: civil, timezone: UTC, dates: {start: 2021-01-01, stop: 2500-06-21, step: 0}, window: {start: 10:00, stop: 14:00, step: 1}}",
        [
            "study.yaml:4:70: time.dates.stop: must be a date of the years 1700 to 2200 (got '2500-06-21')",
            "study.yaml:4:88: time.dates.step: must be at least 1 d (got 0)",
        ],
    ),
    (
        "receiver",
        "receiver: {height: 5 yd}",
        [
            "study.yaml:7:20: receiver.height: unknown unit 'yd'; use 'm', 'mm', 'cm', 'km', 'in' or 'ft' (got '5 yd')",
        ],
    ),
    (
        "receiver",
        "receiver: {height:95}",
        [
            "study.yaml:7:12: receiver.height:95: unknown key; write 'height: 95', with a colon and a space",
        ],
    ),
    (
        "receiver",
        "receiver: {height 95}",
        [
            "study.yaml:7:12: receiver.height 95: unknown key; write 'height: 95', with a colon and a space",
        ],
    ),
    (
        "receiver",
        "receiver: {height: 60, 120}",
        [
            "study.yaml:7:24: receiver.120: unknown key; several values stand in brackets, as [1, 2.5], and decimals follow a point",
        ],
    ),
    (
        "receiver",
        "receiver: {height: '95,5'}",
        [
            "study.yaml:7:20: receiver.height: must be a length in m, a number or text such as '1.5 m'; decimals follow a point, not a comma (got '95,5')",
        ],
    ),
    (
        "receiver",
        "receiver: {height: '60:120:20'}",
        [
            "study.yaml:7:20: receiver.height: must be a length in m, a number or text such as '1.5 m'; a range is {start, stop, step} or {start, stop, num} (got '60:120:20')",
        ],
    ),
    (
        "site",
        "site: {lat: 37, lon: -2}",
        [
            "study.yaml:2:8: site.lat: unknown key; did you mean 'latitude'?",
            "study.yaml:2:17: site.lon: unknown key; did you mean 'longitude'?",
        ],
    ),
    (
        "site",
        "sites: {Almeria: {latitude: 37}}",
        [
            "study.yaml:2:8: sites: must be a list of named sites or {file: NAME.csv} (got a mapping)",
        ],
    ),
    (
        "file",
        "site:\n  latitude:30\n  altitude: 3",
        [
            "study.yaml:3:11: not valid YAML: mapping values are not allowed in this context; line 2 needs a space after the colon: 'latitude: ...'",
        ],
    ),
]
