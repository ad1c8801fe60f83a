"""Whose processors do the work, where it is not this machine alone."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Group, Parameter

from exposight.cli.app import UsageError
from exposight.workers import DaskCluster


@Parameter("*", group=Group("On a cluster", sort_key=5))
@dataclass(frozen=True, kw_only=True)
class ClusterOptions:
    """A Dask scheduler, and why it may be trusted.

    Parameters
    ----------
    cluster
        Run tasks on a Dask scheduler's workers, such as tcp://127.0.0.1:8786. All need this version
        of exposight and, where captures are kept, must reach the campaign's folder at the same
        path. Whoever reaches a scheduler runs code on its workers: beyond this machine give one of
        the next two.
    cluster_tls
        Folder with ca.pem, cert.pem and key.pem, for a scheduler at tls://HOST:8786 (security.md).
    i_trust_this_network
        Use a scheduler on another machine without TLS, where nobody else is in the network.
    """

    cluster: Annotated[str | None, Parameter(metavar="ADDRESS")] = None
    cluster_tls: Annotated[Path | None, Parameter(metavar="FOLDER")] = None
    i_trust_this_network: bool = False

    @property
    def chosen_cluster(self) -> DaskCluster | None:
        """The cluster, if one was given."""
        if self.cluster is None:
            if self.cluster_tls is not None or self.i_trust_this_network:
                msg = "--cluster-tls and --i-trust-this-network go with --cluster ADDRESS"
                raise UsageError(msg)
            return None
        return DaskCluster(
            self.cluster, tls=self.cluster_tls, trusted_network=self.i_trust_this_network
        )


NO_CLUSTER = ClusterOptions()
