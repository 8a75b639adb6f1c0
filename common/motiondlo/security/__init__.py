"""Who may come in through the gate: roles, the cell's authority and certificates, access control."""
