"""Exchange with the tools that users have already: SolarPILOT, SAM, pandas, spreadsheets."""
