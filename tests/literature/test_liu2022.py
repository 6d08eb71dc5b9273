"""Readings of the model of Liu, Peng and Yan (2022), Energies 15, 3261, doi 10.3390/en15093261.

Tables, figures and claims stand with their verdicts in studies/published/, which `test_index` holds the studies to. The
paper states neither its tolerance nor its hours; 4 mrad and a window from 07:00 to 21:00 at UTC+8 were fitted.
"""

from __future__ import annotations

import numpy as np

from tests.conftest import shipped
from tests.literature import liu2022_readings as readings


def test_longitude_effect_is_the_window_s():
    """With daylight only and the rigid model all six sites lie between 0.634 and 0.646 on 21 June."""
    means = shipped("liu2022_daylight")["effective_tracking_factor_mean_over_directions"]
    mean = means.sel(date="2021-06-21", model="rigid")
    assert mean.sizes == {"site": 6}
    assert 0.6335 <= float(mean.min()) <= float(mean.max()) <= 0.6460


def test_the_first_reading_is_the_package_s():
    first = {key: words[0] for key, words in readings.CHOICES.items()}
    solstice = shipped("liu2022_solstice")["effective_tracking_factor"].isel(date=0).sel(axis_tilt=0.1)
    for level, steep in ((0.0, 0.0), (0.2, 0.0), (0.0, -0.4)):
        here = solstice.sel(home_azimuth_offset=level, home_elevation_offset=steep)
        np.testing.assert_allclose(readings.factor("Dunhuang", first, level, steep), here, rtol=0, atol=1e-12)


def test_deviations_of_table_2_fit_n_minus_1_better_than_n():
    """Equation 18 prints 1/n: at 4 mrad and 07:00 to 21:00 four of six deviations then miss 0.0035.

    With hours and tolerance fitted to either, the 12 numbers are 0.0018 away with 1/(n - 1) and 0.0020 with 1/n.
    """
    here = shipped("liu2022_table2")["effective_tracking_factor_std_over_directions"].squeeze()
    printed = np.array([readings.STD[site] for site in here["site"].to_numpy()])
    apart = [abs(here * scale - printed).to_numpy() for scale in (1.0, np.sqrt(23 / 24))]
    assert [(each <= 0.0035).sum() for each in apart] == [6, 2]
    (sample, *window), (population, *other) = readings.window_fit(23), readings.window_fit(24)
    np.testing.assert_allclose([window, other], [[7.5, 21.0, 4.1]] * 2, rtol=1e-12)
    np.testing.assert_allclose([sample, population], [0.0018, 0.0020], atol=5e-5)


def test_no_other_reading_meets_table_2_and_none_meets_every_claim():
    """All signs, carriers and means of an offset, for the paper's mount and for each single change of it."""
    first = {key: words[0] for key, words in readings.CHOICES.items()}
    changed = [first | {key: word} for key, words in readings.CHOICES.items() for word in words[1:]]
    found = [(reading, claims) for one in (first, *changed) for reading, claims in readings.judged(one)]
    fitting = [claims for reading, claims in found if claims["Table 2: means"]]
    assert len(fitting) == 3 * 24  # with the paper's mount, the foot or the top leaning, and with east for west
    assert max(sum(claims.values()) for _, claims in found) == max(sum(claims.values()) for claims in fitting) == 12
    never = {name for name in fitting[0] if not any(claims[name] for claims in fitting)}
    assert never == {
        "9: worst at 90",
        "9: best at 15",
        "9: Baotou and Haerbin lowest",
        "7a: worst at 0",
        "7b: worst at 345",
    }
    order = ("8: horizontal better below 0", "8: vertical better above 0", "8: horizontal steadier")
    assert not any(all(claims[name] for name in order) for claims in fitting)
