"""Helpers of the tests: what more than one test file needs, and no test.

The model of the chip is apart, in `fake_i2c`; the bench of the fault campaign is in
`faults`, beside the campaign.
"""
