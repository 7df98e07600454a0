"""Plugin for QGIS: tools of the Processing toolbox that plan routes by the program `renew`.

QGIS has a Python of its own, in which nothing is installed for this: the plans are made by a
process.
"""


def classFactory(iface):
    """Return the plugin, as QGIS asks for it when it loads the package."""
    from .provider import Plugin

    return Plugin(iface)
