"""Parts that several studies share: populations, measurements, reports, verification, checks, power laws, ascents."""
