"""`python -m cwcli`."""

from cwcli.cli.main import main

main()
