"""SolarPILOT's engine through PySAM, for comparison: one total field efficiency at each of a set of sun positions."""

import datetime as dt
import tempfile
import time
from pathlib import Path

import numpy as np

# Everything that is not geometry is made neutral: perfect mirrors, clear air, no costs. Facets are 2 x 2, since
# single ones crash this engine.
_NEUTRAL = {
    **dict.fromkeys(("c_atm_0", "c_atm_1", "c_atm_2", "c_atm_3", "cant_type", "check_max_flux", "contingency_rate"), 0),
    **dict.fromkeys(("cost_sf_fixed", "heliostat_spec_cost", "is_optimize", "land_spec_cost", "opt_algorithm"), 0),
    **dict.fromkeys(("opt_flux_penalty", "rec_cost_exp", "rec_hl_perm2", "rec_ref_cost", "receiver_type"), 0),
    **dict.fromkeys(("sales_tax_frac", "sales_tax_rate", "site_spec_cost", "tower_exp", "tower_fixed_cost"), 0),
    **dict.fromkeys(("calc_fluxmaps", "helio_active_fraction", "helio_reflectance", "rec_absorptance"), 1),
    **dict.fromkeys(("rec_aspect", "rec_ref_area", "opt_max_iter", "focus_type", "n_cav_rec_panels"), 1),
    **{"dens_mirror": 0.97, "dni_des": 900, "flux_max": 1e6, "helio_optical_error": 1e-3, "rec_height": 10},
    **{"land_max": 20, "land_min": 0.3, "q_design": 20, "opt_conv_tol": 0.1, "opt_init_step": 0.1},
    **{"n_facet_x": 2, "n_facet_y": 2, "n_flux_x": 4, "n_flux_y": 4, "delta_flux_hrs": 1, "n_flux_days": 8},
    **{"cav_rec_height": 5, "cav_rec_span": 180, "cav_rec_width": 5},
    **{"csp.pt.sf.fixed_land_area": 45, "csp.pt.sf.land_overhead_factor": 1},
}


def measure(
    x: np.ndarray, y: np.ndarray, side: float, target_height: float, **settings: float
) -> tuple[float, np.ndarray, np.ndarray]:
    """Seconds of the processor, efficiencies and flux maps at the engine's positions of the sun.

    A row of efficiencies has azimuth from south, positive west, zenith [deg] and efficiency; a row of maps is one level
    at one position. `settings` are PySAM's, in place of perfect mirrors in clear air. ImportError without PySAM.
    """
    from PySAM import Solarpilot
    from PySAM.PySSC import PySSC

    library = PySSC()
    data = library.data_create()
    numbers = {**_NEUTRAL, "helio_width": side, "helio_height": side, "h_tower": target_height, **settings}
    for name, value in numbers.items():
        library.data_set_number(data, name.encode(), float(value))
    library.data_set_matrix(data, b"helio_positions_in", np.stack((x, y), axis=1).tolist())
    with tempfile.TemporaryDirectory() as folder:
        weather = Path(folder) / "weather.csv"
        weather.write_text(_weather())
        library.data_set_string(data, b"solar_resource_file", str(weather).encode())
        model = Solarpilot.wrap(data)
        start = time.process_time()  # of all threads
        model.execute(0)
        spent, found = time.process_time() - start, model.Outputs
        return spent, np.array(found.opteff_table), np.array(found.flux_table)


def _weather() -> str:
    """A weather file that the engine accepts; its values do not matter here."""
    lines = [
        "Source,Location ID,City,State,Country,Latitude,Longitude,Time Zone,Elevation",
        "none,1,none,none,none,30,0,0,0",
        "Year,Month,Day,Hour,Minute,GHI,DNI,DHI,Tdry,Tdew,Pres,Wspd,Wdir",
    ]
    for hour in range(8760):
        when = dt.datetime(2021, 1, 1) + dt.timedelta(hours=hour)
        lines.append(f"2021,{when.month},{when.day},{when.hour},30,500,800,100,20,5,1010,2,0")
    return "\n".join(lines) + "\n"
