"""The report of campaigns: one file of HTML with everything in it."""
