package Seals "Rod of a pneumatic cylinder, moved by a tester against the pressure"
  // "neutral": an effect that the catalogue (effects/) may switch on.

  block Chamber "Pressure on the piston"
    parameter Real A(unit = "m2", min = 1e-6, max = 1) = 4.9087385e-4 "Area of the piston, 25 mm bore";
    parameter Real offset(unit = "N", min = -1e3, max = 1e3) = 0 "Constant force: the tester's zero; neutral 0";
    input Real p(unit = "Pa") "Gauge pressure";
    output Real F(unit = "N") "Force on the rod";
  equation
    F = A*p + offset;
  end Chamber;

  block Seal "Friction of piston and rod seals"
    parameter Real F_c(unit = "N", min = 0, max = 1e4) = 4 "Coulomb friction at p_0";
    parameter Real growth(unit = "1/Pa", min = -1e-5, max = 1e-4) = 0 "Growth of Coulomb friction with pressure, relative; neutral 0";
    parameter Real p_0(unit = "Pa") = 1e5 "Pressure at which friction is F_c";
    parameter Real d(unit = "N.s/m", min = -1e4, max = 1e5) = 0 "Viscous friction; neutral 0";
    parameter Real direction(unit = "1", min = -1, max = 1) = 0 "Share by which friction is higher for v > 0, lower for v < 0; neutral 0";
    parameter Real stribeck(unit = "1", min = -1, max = 10) = 0 "Share by which friction is higher at rest; neutral 0";
    parameter Real v_s(unit = "m/s", min = 1e-5, max = 1) = 2e-3 "Speed at which that share has faded to a third";
    parameter Real x_pre(unit = "m", min = 1e-6, max = 0.1) = 2e-4 "Way over which friction builds up after a reversal";
    input Real v(unit = "m/s") "Speed, > 0 against the pressure";
    input Real p(unit = "Pa") "Gauge pressure";
    output Real F(unit = "N") "Friction, against v";
    Real z(start = 0, fixed = true, unit = "1") "Share of the Coulomb friction that has built up";
  equation
    der(z) = (v - noEvent(abs(v))*z)/x_pre;
    F = d*v + F_c*(1 + growth*(p - p_0))*(1 + direction*z)*(1 + stribeck*exp(-noEvent(abs(v))/v_s))*z;
  end Seal;

  model Plant "Speed and pressure in, force of the tester on the rod out"
    input Real v(start = 0, unit = "m/s") "Speed";
    input Real p(start = 0, unit = "Pa") "Gauge pressure";
    output Real F(unit = "N") "Force of the tester";
    Chamber chamber;
    Seal seal;
  equation
    chamber.p = p;
    seal.p = p;
    seal.v = v;
    F = chamber.F + seal.F;
  end Plant;
end Seals;
