"""Speed against what a user would pick instead: ratios measured in one run, with medians. Part of the source
checkout, not of the installed package."""
