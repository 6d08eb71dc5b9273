"""Study files: strict YAML in, one validated and frozen study out.

``source`` reads the text, ``units`` and ``sweep`` give numbers their meaning, ``fields`` and ``blocks`` say
what may stand where, ``study`` is the whole, ``load`` puts them together and reports every problem at its
line and column.
"""
