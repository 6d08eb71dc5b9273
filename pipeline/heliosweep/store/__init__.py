"""Results on disk: NetCDF files, digests and manifests."""
