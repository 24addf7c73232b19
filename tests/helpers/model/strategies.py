"""Random admissible tactors and skins for the property tests."""

from hypothesis import strategies as st

from model.parameters import Skin, Tactor


def logarithmic(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(0, 1).map(lambda u: float(low * (high / low) ** u))


@st.composite
def tactors(draw: st.DrawFn) -> Tactor:
    """Any size from 5 mm to 10 cm, no segment shorter than a tenth of it, stiffness steps up to twenty."""
    L = draw(logarithmic(5e-3, 0.1))
    l1 = draw(st.floats(0.15, 0.6))
    l2 = draw(st.floats(l1 + 0.1, 0.9))
    h_Al, rho1 = L * draw(logarithmic(3e-3, 3e-2)), draw(logarithmic(1e-3, 1e-1))
    k1 = 69e9 * 2e-2 * h_Al**3 / 12
    tau = L**2 * (rho1 / k1) ** 0.5
    return Tactor(
        L=L,
        L1=l1 * L,
        L2=l2 * L,
        h_Al=h_Al,
        rho1=rho1,
        rho2=rho1 * draw(logarithmic(0.5, 4)),
        k2=k1 * draw(logarithmic(0.3, 20)),
        mu=draw(st.sampled_from([-1, 1])) * draw(logarithmic(1e-6, 1e-4)),
        c0=rho1 / tau * draw(logarithmic(0.05, 30)),
        m_add=rho1 * L * draw(st.floats(0, 30)),
    )


@st.composite
def pairs(draw: st.DrawFn) -> tuple[Tactor, Skin]:
    """A tactor with a skin from hardly there to far stiffer and more viscous than the beam itself."""
    t = draw(tactors())
    return t, Skin(t.k2 / t.L**4 * draw(logarithmic(1e-3, 300)), t.c_bar * draw(logarithmic(1e-3, 300)))
