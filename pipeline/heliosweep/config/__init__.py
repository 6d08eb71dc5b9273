"""Study files: strict YAML in, one validated and frozen study out.

``source`` reads the text, ``units``, ``sweep`` and ``values`` read values, ``blocks`` and ``study`` declare keys, and
``load`` reports
every problem at its line and column.
"""
