"""What a plan is given: chart, current, vessel, fuel law (Eq. 4), and the check of arguments."""
