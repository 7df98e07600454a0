"""The plugin and its provider, which brings the algorithms into the Processing toolbox."""

from processing.core.ProcessingConfig import ProcessingConfig, Setting
from qgis.core import QgsApplication, QgsProcessingProvider

from .algorithms import CheckARoute, RouteFromAToB, Scenario, WhenToLeave
from .program import SETTING


class Provider(QgsProcessingProvider):
    """The algorithms of RENEW."""

    def id(self):
        """Return the beginning of the algorithms' names, as in `renew:route`."""
        return "renew"

    def name(self):
        """Return the name of the group in the toolbox."""
        return "RENEW routes"

    def load(self):
        """Offer the setting for the program's path, and load the algorithms."""
        ProcessingConfig.settingIcons[self.name()] = self.icon()
        ProcessingConfig.addSetting(
            Setting(self.name(), SETTING, "Path of the program renew (empty: it is looked for)", "")
        )
        ProcessingConfig.readSettings()
        self.refreshAlgorithms()
        return True

    def unload(self):
        """Take the setting away."""
        ProcessingConfig.removeSetting(SETTING)

    def loadAlgorithms(self):
        """Add the algorithms."""
        for algorithm in (RouteFromAToB, WhenToLeave, CheckARoute, Scenario):
            self.addAlgorithm(algorithm())


class Plugin:
    """What QGIS loads: it registers the provider."""

    def __init__(self, iface):
        """Keep nothing of the window: `qgis_process` has none."""
        del iface
        self.provider = None

    def initProcessing(self):
        """Register the provider, also without a window."""
        self.provider = Provider()
        QgsApplication.processingRegistry().addProvider(self.provider)

    def initGui(self):
        """Register the provider in a window."""
        self.initProcessing()

    def unload(self):
        """Take the provider away."""
        if self.provider is not None:
            QgsApplication.processingRegistry().removeProvider(self.provider)
            self.provider = None
