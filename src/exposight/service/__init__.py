"""HTTP interface: what models know, measuring runs and campaigns, asked over the network.

Imported only where the extra ``service`` is installed; `Client` needs httpx alone.
"""
