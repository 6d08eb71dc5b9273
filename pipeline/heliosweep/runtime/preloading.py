"""What the process does first that workers are forked from."""

import gc

gc.disable()  # until all is imported, see `preloaded`: looking at each object takes a fifth of that time
