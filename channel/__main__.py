"""`python -m channel`."""

from channel.cli.commands import main

if __name__ == "__main__":
    main(prog_name="python -m channel")
