"""Study files: strict YAML in, one validated and frozen study out.

``source`` reads the text; ``units``, ``sweep`` and ``values`` read values; ``blocks``, ``times``, ``layouts``,
``sites``, ``sample``, ``search`` and ``study`` declare keys; ``tables`` and ``weather_files`` read named files;
``load`` reports every problem at its line and column.
"""
