def claims(ds): return []
def curvature_figure(ds): raise NotImplementedError
def geometry_figure(ds): raise NotImplementedError
def manifold_figure(ds): raise NotImplementedError
def summary(ds): return {}
