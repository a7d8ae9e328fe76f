"""Runs that have ended: run again, told apart number by number, compared, and described as a paper must."""
