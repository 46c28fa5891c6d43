"""Machine code of this project's functions: CasADi's expressions, and loops in a part of Python."""
