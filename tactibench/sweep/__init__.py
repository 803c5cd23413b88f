"""Many runs, and large data sets, on the processes of one machine or of a cluster."""
