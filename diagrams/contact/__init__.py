"""Arms under hybrid position/force control on surfaces (the thesis)."""
