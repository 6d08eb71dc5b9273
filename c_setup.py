import time, numpy as np
from tests.bench.bench_field import *
from heliosweep.kernels.field.efficiency import _sorted
f=staggered(100000); s=year(0)
def tm(fn,n=12):
    fn(); b=9
    for _ in range(n):
        t=time.process_time(); fn(); b=min(b,time.process_time()-t)
    return round(b*1e3,2)
m=aimed(*f)
print('aimed',tm(lambda:aimed(*f)),'sorted',tm(lambda:_sorted(m,s,0,0,250)),'cells',tm(lambda:by_cells(m)))
mm,g=by_cells(m)
from heliosweep.kernels.field.neighbours import places
print('places',tm(lambda:places(g,0,250)))
for st in (0,50000,99000): print(st,'blockers',tm(lambda:blockers_of(places(g,st,st+250),mm,g)), 'year', tm(lambda:field_sums(*f,1,s,st,st+250),3), 'few', tm(lambda:field_sums(*f,1,s[:1],st,st+250),5))
