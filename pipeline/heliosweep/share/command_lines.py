"""Examples of every command, as its help and the documentation show them."""

EXAMPLES = {
    "validate": ("my_field.yaml", "studies/*.yaml", "my_field.yaml --set receiver.height=90"),
    "plan": ("my_field.yaml", "my_field.yaml --set 'site.latitude=[0, 20, 40]'"),
    "run": (
        "my_field.yaml",
        "my_field.yaml --set receiver.height=90 --set tracking=azimuth_elevation",
        "my_field.yaml --output results/first --scheduler processes --workers 4",
    ),
    "status": ("", "my_field.yaml"),
    "verify": ("my_field.yaml", "outputs/*/"),
    "compare": (
        "outputs/first outputs/second",
        "first.nc second.nc --rtol 1e-9",
        "low.yaml middle.yaml high.yaml --page heights.html",
    ),
    "export": (
        "outputs/first --csv table.csv --variable field_optical_efficiency",
        "outputs/first --output whole.nc",
    ),
    "convert": ("my_field.yaml positions.csv", "positions.csv field.csv --to csv"),
    "table": ("my_field.yaml -o efficiency.csv --azimuth 0:345:15 --elevation 5:85:10",),
    "report": ("my_field.yaml", "outputs/first --format png,svg,pdf"),
    "pack": ("my_field.yaml", "outputs/first -o first.zip --license CC0-1.0"),
    "new": ("field_efficiency", "dish_tracking my_dish.yaml"),
    "explain": ("receiver.height", "field_efficiency optics", "field_efficiency"),
    "examples": ("", "chong2012_table2 --to studies"),
    "schema": ("field_efficiency",),
    "families": ("",),
}
"""What may follow ``heliosweep COMMAND``, for each command."""


def epilog_of(command: str) -> str:
    """Return the examples of a command, as the end of its help."""
    return "\n".join(["examples:", *(f"  heliosweep {command} {line}".rstrip() for line in EXAMPLES.get(command, ()))])
