"""Where the estimate goes: the lat/long log and the files beside it."""
