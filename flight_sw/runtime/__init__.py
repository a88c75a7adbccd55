"""What the process runs on: compiler, kernel cache, privileges, streams, histograms."""
