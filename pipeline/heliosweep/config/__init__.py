"""Study files: strict YAML in, one validated and frozen study out.

``source`` reads the text, ``units``, ``sweep`` and ``values`` say what a value means, ``blocks`` what may stand where,
``study`` is the whole, ``load`` puts them together and reports every problem at its line and column.
"""
