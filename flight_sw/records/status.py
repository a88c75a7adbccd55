"""Status codes of the flight software: never renumbered, text formed on the ground.

| code | severity | cause | what the computer does |
| --- | --- | --- | --- |
| OK | - | - | - |
| SATURATED | info | a command or a cosine left its range | uses the nearest allowed value |
| NONFINITE | error | NaN or infinity in a command | holds the last command |
| NO_FIX | warning | navigation set missing or inconsistent | holds the last command |
| DOMAIN | warning | a division or root outside its domain | uses the guarded value |
"""

OK = 0
SATURATED = 1
NONFINITE = 2
NO_FIX = 3
DOMAIN = 5
