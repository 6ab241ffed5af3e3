"""Rounds of diagnoses: every loop's window to the workers, what they find to the open findings.

Nothing here judges (`estimator.diagnosis`) or decides a finding's life (`fieldlink.findings`).
"""
