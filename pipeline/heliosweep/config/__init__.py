"""Study files: read strict YAML, and return a validated and frozen study.

The module ``source`` reads the text, and ``values`` reads values with their units and sweeps. The modules ``blocks``,
``times``, ``layouts``, ``sites``, ``sample``, ``search`` and ``study`` declare keys. The modules ``tables`` and
``weather_files`` read further files, and ``load`` reports every problem with its line and column.
"""
