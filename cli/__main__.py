"""`python -m suspend_cli`: the same as the command `suspend`, which some shells hide behind a builtin."""

from suspend_cli.start import main

main()
