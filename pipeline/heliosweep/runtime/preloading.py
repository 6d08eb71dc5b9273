"""What the process does first that workers are forked from."""

import gc

USUAL = gc.get_threshold()
"""How often the garbage collector looks, which `preloaded` goes back to."""

gc.set_threshold(10**6)  # more objects than imports make: looking at each takes a fifth of their time
