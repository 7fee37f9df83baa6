package PneuGantry "Pneumatic gantry robot that tracks a workpiece's edge with a set contact force"
  // Source of every number: M. Abu Mallouh, PhD thesis, Queen's University, 2008. "[A]" marks an assumption where the thesis is
  // silent, "[D]" a value derived from its figures or tables. Parameters named "neutral" change nothing at their default.

  package Types "Physical quantities, SI"
    type Position = Real(final quantity = "Length", final unit = "m", nominal = 0.01);
    type Velocity = Real(final quantity = "Velocity", final unit = "m/s", nominal = 0.1);
    type Acceleration = Real(final quantity = "Acceleration", final unit = "m/s2");
    type Force = Real(final quantity = "Force", final unit = "N", nominal = 10);
    type Mass = Real(final quantity = "Mass", final unit = "kg");
    type Voltage = Real(final quantity = "ElectricPotential", final unit = "V");
    type Time = Real(final quantity = "Time", final unit = "s");
    type Angle = Real(final quantity = "Angle", final unit = "rad");
    type Ratio = Real(final unit = "1");
    type FrictionLaw = enumeration(
      none "no Coulomb friction",
      vdfm "velocity dependent, stick band (Eq. 3-18, 3-19)",
      ddfm "displacement dependent, Dahl (Eq. 4-8)",
      lugre "bristle deflection with Stribeck curve",
      stribeck "stick band, smooth decay from F_s to F_d");
    type EdgeShape = enumeration(
      straight "z_w = 0",
      inclined "constant slope",
      curved "towards -x: a 50 deg fall, then a 10 deg rise (Fig. 3.33, 4.36)");
  end Types;

  import PneuGantry.Types.*;

  block Valve "Proportional pressure valve with the lag of line and chamber (Eq. 4-5)"
    parameter Real K(unit = "N/V", min = 0, max = 1e4) = 100 "Steady force per volt; [D] line through Tables 4.1-4.5";
    parameter Voltage u_0(min = -5, max = 5) = 0.735 "Command at which force begins; [D] line through Tables 4.1-4.5";
    parameter Force f_max(min = 0, max = 1e5) = 156 "Force at full supply pressure: 551 kPa on the bore";
    parameter Integer direction(min = -1, max = 1) = 1 "Axis direction in which the valve pushes: +1 or -1 (section 4.3.1)";
    parameter Boolean bidirectional = false "true: the valve also pulls (thesis variant of section 4.3.1)";
    parameter Time tau(min = 1e-3, max = 100) = 0.15 "Lag time constant at mid-stroke (section 4.1.3)";
    parameter Ratio lag_low(min = 0.01, max = 100) = 1 "tau at the lower end of the stroke / tau; neutral 1 (Tables 4.1-4.5)";
    parameter Ratio lag_high(min = 0.01, max = 100) = 1 "tau at the upper end of the stroke / tau; neutral 1";
    parameter Ratio lag_asymmetry(min = -0.95, max = 0.95) = 0 "tau grows by this share while |f_a| rises, shrinks while it falls; neutral 0";
    parameter Real lag_shape[6](each min = -3, each max = 3) = {0, 0, 0, 0, 0, 0} "Logarithm of tau along the stroke, beside that: coefficients of xi to xi^6; neutral 0";
    parameter Force lag_blend(min = 0, max = 1000) = 0 "Force difference over which rising turns to falling; 0: at once";
    parameter Time tau_2(min = 0, max = 100) = 0 "Time constant of a second stage before the chamber; neutral 0";
    parameter Time spool_time(min = 0, max = 10) = 0 "1 / natural frequency of a spool that swings, before the chamber; neutral 0";
    parameter Ratio spool_zeta(min = 0.01, max = 10) = 0.3 "Its damping";
    parameter Ratio leak(min = 0, max = 100) = 0 "Force lost, per lag, of what exceeds leak_from; neutral 0";
    parameter Force leak_from(min = 0, max = 1e5) = 10 "Force from which the chamber leaks";
    parameter Real slew(unit = "s/N", min = 0, max = 10) = 0 "1 / greatest rate of force; neutral 0";
    parameter Time delay_time(min = 0, max = 0.2) = 0 "Transport delay of the command; neutral 0";
    parameter Voltage play(min = 0, max = 5) = 0 "Half-width of the play (backlash) on the command; neutral 0";
    parameter Ratio play_spread(min = 0, max = 1) = 0 "Three plays in parallel whose half-widths differ by this share; neutral 0";
    parameter Boolean play_centred = false "true: the play starts in its middle at the first command; false: it starts from u = 0";
    parameter Time play_period(min = 1e-5, max = 1) = 1e-3 "Period at which the driver reads its command while play > 0";
    parameter Ratio droop(min = 0, max = 1) = 0 "Steady loss of supply pressure at full force, as a share; neutral 0";
    parameter Ratio droop_exponent(min = 0.1, max = 5) = 1 "The loss grows as force to this power";
    parameter Time droop_time(min = 1e-3, max = 1000) = 2 "Time constant with which the supply recovers";
    parameter Ratio droop_pace(min = 1e-2, max = 100) = 1 "Time constant with which the supply sags / droop_time";
    parameter Ratio droop_flow(min = 0, max = 1) = 0 "Share of the supply pressure that filling the chamber once takes from it; neutral 0";
    parameter Position s_low = 0 "Lower end of the stroke";
    parameter Position s_high = 1 "Upper end of the stroke";
    input Voltage u "Command, 0..5";
    input Position s "Piston position";
    input Force f_manual "Force set by hand through the valve's other port; 0 in automatic running";
    output Force f_a(start = 0, fixed = true) "Actuator force along the axis";
    Real supply(start = 1, fixed = true, unit = "1") "Supply pressure / nominal supply pressure";
    Force f_target "Steady force of the present command";
    Force f_stage(start = 0, fixed = true) "Force behind the second stage";
    Real f_stage_rate(start = 0, fixed = true, unit = "N/s", nominal = 100) "Its rate, where the spool swings";
  protected
    discrete Voltage u_play(start = 0, fixed = true) "Command behind the play";
    discrete Voltage u_narrow(start = 0, fixed = true) "Command behind a narrower play";
    discrete Voltage u_wide(start = 0, fixed = true) "Command behind a wider play";
    discrete Boolean placed(start = false, fixed = true) "The play has read its first command";
    Voltage u_late "Command behind the transport delay";
    Voltage u_eff "Command behind delay and play";
    Ratio xi "Position: -1 at the lower end, 0 in the middle, +1 at the upper end";
    Time tau_eff;
    Ratio along "Factor of tau along the stroke";
    Ratio rising "1 while |f_a| rises, -1 while it falls";
    Force f_drive;
    Real rate(unit = "N/s");
    Ratio wanted "Steady loss of supply pressure";
  equation
    // Until the first command has passed the valve rests, as f_a does at the start.
    u_late = if delay_time > 0 and time < delay_time then u_0
      else noEvent(if delay_time > 0 then delay(u, if delay_time > 0 then delay_time else 1e-3, 0.2) else u);
    when sample(0, if play > 0 then play_period else 1e9) then
      u_play = if play_centred and not pre(placed) then u_late else max(min(pre(u_play), u_late + play), u_late - play);
      u_narrow = if play_centred and not pre(placed) then u_late else max(min(pre(u_narrow), u_late + play*(1 - play_spread)), u_late - play*(1 - play_spread));
      u_wide = if play_centred and not pre(placed) then u_late else max(min(pre(u_wide), u_late + play*(1 + play_spread)), u_late - play*(1 + play_spread));
      placed = true;
    end when;
    u_eff = noEvent(if play > 0 then (if play_spread > 0 then (u_narrow + u_play + u_wide)/3 else u_play) else u_late);
    f_target = f_manual + direction*supply*min(max(K*(u_eff - u_0), if bidirectional then -f_max else 0), f_max);
    xi = 2*(s - s_low)/(s_high - s_low) - 1;
    der(f_stage) = noEvent(if tau_2 > 0 then (f_target - f_stage)/(if tau_2 > 0 then tau_2 else 1) else f_stage_rate);
    der(f_stage_rate) = noEvent(if spool_time > 0 then ((f_target - f_stage)/(if spool_time > 0 then spool_time else 1) - 2*spool_zeta*f_stage_rate)/(if spool_time > 0 then spool_time else 1) else 0);
    f_drive = noEvent(if tau_2 > 0 or spool_time > 0 then f_stage else f_target);
    along = noEvent(if sum(abs(lag_shape[i]) for i in 1:6) > 0 then exp(xi*(lag_shape[1] + xi*(lag_shape[2] + xi*(lag_shape[3] + xi*(lag_shape[4] + xi*(lag_shape[5] + xi*lag_shape[6])))))) else 1);
    rising = noEvent(if lag_blend > 0 then tanh((f_drive - f_a)*(if f_a >= 0 then 1 else -1)/(if lag_blend > 0 then lag_blend else 1))
      elseif (f_drive - f_a)*f_a >= 0 then 1 else -1);
    tau_eff = tau*noEvent(1 + (if xi > 0 then (lag_high - 1)*xi else (1 - lag_low)*xi))*along*(1 + lag_asymmetry*rising);
    rate = (f_drive - f_a - noEvent(if leak > 0 then leak*(max(f_a - leak_from, 0) - max(-f_a - leak_from, 0)) else 0))/tau_eff;
    der(f_a) = noEvent(if slew > 0 then max(min(rate, 1/(if slew > 0 then slew else 1)), -1/(if slew > 0 then slew else 1)) else rate);
    wanted = noEvent(if droop > 0 then droop*(if droop_exponent == 1 then abs(f_a)/f_max else (abs(f_a)/f_max + 1e-12)^droop_exponent) else 0);
    der(supply) = noEvent((1 - wanted - supply)/(droop_time*(if 1 - wanted < supply then droop_pace else 1))
      - (if droop_flow > 0 then droop_flow*max(direction*(f_drive - f_a)/tau_eff, 0)/f_max else 0));
  end Valve;

  block Friction "Friction of a cylinder without its viscous part"
    parameter FrictionLaw law = FrictionLaw.vdfm "Friction law";
    parameter Force F_s(min = 0, max = 1e4) = 20 "Static (break-away) level (Tables C.1, C.2)";
    parameter Force F_d(min = 0, max = 1e4) = 15 "Dynamic level (Tables C.1, C.2)";
    parameter Velocity v_th(min = 1e-6, max = 1) = 0.01 "Half-width of the stick band (Eq. 3-18)";
    parameter Velocity v_s(min = 1e-5, max = 10) = 0.02 "Stribeck speed: decay from F_s to F_d (laws stribeck and lugre)";
    parameter Force beta(min = 1e-3, max = 1e4) = 12 "Limit force of the DDFM; [A] read off Fig. 4.14, 4.17";
    parameter Real sigma(unit = "N/m", min = 1, max = 1e9) = 1e5 "Presliding stiffness at F = 0 (ddfm, lugre); [A] read off Fig. 4.14, 4.17";
    parameter Ratio exponent(min = 0.2, max = 5) = 2 "Exponent of the DDFM; 2 in Eq. 4-8, 1 for the plain Dahl model";
    parameter Ratio soft_share(min = 0, max = 0.95) = 0 "Share of the limit that a second, softer spring carries (ddfm); neutral 0";
    parameter Ratio soft_ratio(min = 1e-3, max = 1) = 0.2 "Its displacement to slip is that of the first / soft_ratio";
    parameter Real sigma_1(unit = "N.s/m", min = 0, max = 1e5) = 20 "Bristle damping (lugre) [A]";
    parameter Ratio level(min = 0, max = 100) = 1 "Scales F_s, F_d and beta together; neutral 1";
    parameter Ratio position_slope(min = -1, max = 1) = 0 "Share by which the level rises from mid-stroke to the upper end; neutral 0";
    parameter Ratio position_bow(min = -1, max = 10) = 0 "Share by which the level at both ends exceeds that at mid-stroke; neutral 0";
    parameter Ratio asymmetry(min = -0.99, max = 0.99) = 0 "Share by which the level is higher for v > 0 and lower for v < 0; neutral 0";
    parameter Ratio position_table[11](each min = -1, each max = 10) = {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0} "Share by which the level is higher, at nodes evenly spaced from the lower to the upper end; neutral 0";
    parameter Ratio position_fine[21](each min = -1, each max = 10) = {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0} "The same at 21 nodes, cubic between them; neutral 0";
    parameter Ratio load(min = 0, max = 10) = 0 "Level gained per newton of contact force; neutral 0";
    parameter Ratio load_share(min = 0, max = 100) = 0 "Share by which 10 N of contact force raise the level; neutral 0";
    parameter Ratio load_exponent(min = 0.1, max = 5) = 1 "It grows as the contact force to this power";
    parameter Ratio warm(min = -10, max = 0.95) = 0 "Share of the level that is lost when the seals are warm; neutral 0";
    parameter Real warm_rate(unit = "1/s", min = 0, max = 100) = 0.1 "Rate at which they warm by themselves";
    parameter Real warm_work(unit = "1/J", min = 0, max = 1000) = 0 "Warming per work of friction";
    parameter Ratio dwell(min = -1, max = 10) = 0 "Share by which the break-away level grows per decade of time at rest; neutral 0";
    parameter Time dwell_from(min = 1e-3, max = 100) = 0.05 "Time at rest at which that growth begins";
    parameter Ratio stribeck_exponent(min = 0.1, max = 5) = 1 "Shape of the decay from F_s to F_d (law stribeck): exp(-((|v| - v_th)/v_s)^n)";
    parameter Position s_low = 0 "Lower end of the stroke";
    parameter Position s_high = 1 "Upper end of the stroke";
    input Velocity v "Piston speed";
    input Position s "Piston position";
    input Force f_net "Force that would move the piston";
    input Force f_load "Contact force, >= 0";
    output Force F "Friction force, acts against v";
    Force F_pre(start = 0, fixed = true) "Displacement-dependent force (ddfm, lugre)";
    Force F_soft(start = 0, fixed = true) "Force of the second, softer spring (ddfm)";
    Real heat(start = 0, fixed = true) "How warm the seals are; 63 % of the change at 1";
    Boolean stick "Inside the stick band";
  protected
    Ratio xi, shape, bumpy, uneven, loaded, rested;
    Real coarse, fine "Place among the nodes of each table, 0 at the first";
    Ratio nodes[23] = cat(1, {3*position_fine[1] - 3*position_fine[2] + position_fine[3]}, position_fine, {3*position_fine[21] - 3*position_fine[20] + position_fine[19]}) "With one beyond each end, on the parabola through the last three";
    Ratio square[19] = {(nodes[i] - 2*nodes[i + 1] + 2*nodes[i + 3] - nodes[i + 4])/2 for i in 1:19} "Changes of a cubic's coefficients at each inner node";
    Ratio cube[19] = {(nodes[i] - 4*nodes[i + 1] + 6*nodes[i + 2] - 4*nodes[i + 3] + nodes[i + 4])/2 for i in 1:19};
    discrete Time stuck_since(start = 0, fixed = true) "Since when it has been in the stick band";
    Force up, down, curve, F_limit, F_pre_limit, F_soft_limit, F_cap;
    Ratio toward "Sign of v, frozen between reversals";
    Boolean banded, bristled, sliding_up, sliding_down, beyond_up, beyond_down;
    Real rate(unit = "N/s");
  equation
    banded = law == FrictionLaw.vdfm or law == FrictionLaw.stribeck;
    bristled = law == FrictionLaw.ddfm or law == FrictionLaw.lugre;
    xi = 2*(s - s_low)/(s_high - s_low) - 1;
    // a table is the curve of one interval and what changes at each node: its coefficients are found once for all positions
    coarse = noEvent(min(max(5*(xi + 1), 0), 10));
    fine = noEvent(min(max(10*(xi + 1), 0), 20));
    bumpy = noEvent(if sum(abs(position_table[i]) for i in 1:11) > 0 then
        position_table[1] + (position_table[2] - position_table[1])*coarse
        + sum((position_table[i - 1] - 2*position_table[i] + position_table[i + 1])*max(coarse - (i - 1), 0) for i in 2:10) else 0);
    uneven = noEvent(if sum(abs(position_fine[i]) for i in 1:21) > 0 then max(
        nodes[12] + (fine - 10)*(nodes[13] - nodes[11] + (fine - 10)*(2*nodes[11] - 5*nodes[12] + 4*nodes[13] - nodes[14] + (fine - 10)*(3*(nodes[12] - nodes[13]) + nodes[14] - nodes[11])))/2
        + sum(kink(i - fine, -square[i], cube[i]) for i in 1:10)
        + sum(kink(fine - i, square[i], cube[i]) for i in 11:19), -0.95) else 0);
    loaded = noEvent(if load_share > 0 then load_share*(if load_exponent == 1 then f_load/10 else (max(f_load, 0)/10 + 1e-12)^load_exponent) else 0);
    der(heat) = noEvent(if abs(warm) > 0 then warm_rate + warm_work*abs(F*v) else 0);
    shape = level*(1 + position_slope*xi + position_bow*xi^2 + bumpy + uneven)*(1 + loaded)*(1 - noEvent(if abs(warm) > 0 then warm*(1 - exp(-heat)) else 0));
    // break-away levels in both directions
    when stick then
      stuck_since = time;
    end when;
    rested = noEvent(if abs(dwell) > 0 and stick then 1 + dwell*log10(1 + max(time - stuck_since, 0)/dwell_from) else 1);
    up = (F_s*shape*rested + load*f_load)*(1 + asymmetry);
    down = (F_s*shape*rested + load*f_load)*(1 - asymmetry);
    // A relation is watched only where its law and mode make it matter: elsewhere its operand is the constant -1.
    sliding_up = (if banded then v - v_th else -1) > 0;
    sliding_down = (if banded then -v - v_th else -1) > 0;
    stick = banded and not sliding_up and not sliding_down;
    beyond_up = (if stick then f_net - up else -1) > 0;
    beyond_down = (if stick then -f_net - down else -1) > 0;
    curve = noEvent(if law == FrictionLaw.stribeck then (F_s - F_d)*exp(-(if stribeck_exponent == 1 then (abs(v) - v_th)/v_s else (max(abs(v) - v_th, 0)/v_s + 1e-12)^stribeck_exponent)) elseif law == FrictionLaw.lugre then (F_s - F_d)*exp(-(v/v_s)^2) else 0);
    toward = if (if bristled then v else 1) >= 0 then 1 else -1;
    F_limit = if law == FrictionLaw.ddfm then beta*shape + load*f_load else (F_d + curve)*shape + load*f_load;
    F_pre_limit = F_limit*(1 + asymmetry*toward);
    F_cap = F_limit*(1 + abs(asymmetry)); // does not jump at a reversal
    rate = noEvent(if law == FrictionLaw.ddfm then (1 - soft_share)*sigma*v*(1 - toward*min(max(F_pre/((1 - soft_share)*F_pre_limit), -1), 1))^exponent
      elseif law == FrictionLaw.lugre then sigma*(v - abs(v)*F_pre/F_pre_limit) else 0);
    der(F_pre) = rate;
    F_soft_limit = soft_share*F_pre_limit;
    der(F_soft) = noEvent(if law == FrictionLaw.ddfm and soft_share > 0 then soft_share*soft_ratio*sigma*v*(1 - toward*min(max(F_soft/(if soft_share > 0 then F_soft_limit else 1), -1), 1))^exponent else 0);
    F = if banded then
          (if sliding_up then ((F_d + curve)*shape + load*f_load)*(1 + asymmetry)
           elseif sliding_down then -((F_d + curve)*shape + load*f_load)*(1 - asymmetry)
           elseif beyond_up then up elseif beyond_down then -down else f_net)
        elseif law == FrictionLaw.ddfm then noEvent(min(max(F_pre + F_soft, -F_cap), F_cap))
        elseif law == FrictionLaw.lugre then F_pre + sigma_1*rate/sigma
        else 0;
  end Friction;

  block Cylinder "Piston with load, friction, cable transducer and end stops (Eq. 4-1)"
    parameter Mass m(min = 1e-3, max = 1e4) = 2.25 "Moving mass (section 4.1.1)";
    parameter Real C(unit = "N.s/m", min = 0, max = 1e5) = 40 "Viscous friction (Table 3.13)";
    parameter Force F_w(min = -1000, max = 1000) = 5 "Cable force of the position transducer, always towards -axis; [A] size of its spring";
    parameter Force cable_rise(min = -1000, max = 1000) = 0 "By which the cable force grows over the stroke, about mid-stroke; neutral 0";
    parameter Force spring(min = -1e4, max = 1e4) = 0 "Force towards mid-stroke that grows to this at the ends; neutral 0";
    parameter Force spring_even(min = -1e4, max = 1e4) = 0 "Its part that grows as the square, towards -axis; neutral 0";
    parameter Force spring_cubic(min = -1e4, max = 1e4) = 0 "Its part that grows as the cube; neutral 0";
    parameter Position s_low(min = -10, max = 10) = 0 "Lower end stop";
    parameter Position s_high(min = -10, max = 10) = 1 "Upper end stop";
    parameter Position s_start(min = -10, max = 10) = 0 "Position at the start; the run starts at rest";
    input Force f_a "Actuator force";
    input Force f_c "Contact force of the robot on the workpiece, this axis";
    input Force f_couple "Further force that drives the axis";
    input Force f_load "Contact force that loads the guide, >= 0";
    input Boolean clamp "true: the carriage is clamped";
    output Position s(start = s_start, fixed = true) "Piston position";
    output Velocity v(start = 0, fixed = true) "Piston speed";
    output Acceleration a "Piston acceleration";
    Friction friction(s_low = s_low, s_high = s_high);
    Boolean at_high "On the upper stop";
    Boolean at_low "On the lower stop";
  protected
    Acceleration a_free "Acceleration without stops and clamp";
    Force f_net;
    Ratio xi "Position: -1 at the lower end, 0 in the middle, +1 at the upper end";
    Boolean held "Pressed against a stop";
  equation
    xi = 2*(s - s_low)/(s_high - s_low) - 1;
    f_net = f_a - f_c - F_w - cable_rise*xi/2 - xi*(spring + xi*(spring_even + xi*spring_cubic)) + f_couple;
    friction.v = v;
    friction.s = s;
    friction.f_net = f_net;
    friction.f_load = f_load;
    m*a_free = f_net - friction.F - C*v;
    at_high = s >= s_high;
    at_low = s <= s_low;
    held = (if at_high then a_free elseif at_low then -a_free else -1) > 0;
    a = if clamp or held then 0 else a_free;
    der(s) = v;
    der(v) = a;
    when s >= s_high then
      reinit(s, s_high);
      reinit(v, min(pre(v), 0));
    elsewhen s <= s_low then
      reinit(s, s_low);
      reinit(v, max(pre(v), 0));
    elsewhen clamp then
      reinit(v, 0);
    end when;
    assert(s_high > s_low, "the upper end stop must lie above the lower one");
  end Cylinder;

  function kink "What changes behind a node of cubics that join there without a jump of slope"
    input Real beyond "Distance behind the node";
    input Real square, cube "Changes of the coefficients of its powers";
    output Real change;
  protected
    Real u "0 ahead of the node";
  algorithm
    u := max(beyond, 0);
    change := u^2*(square + cube*u);
  end kink;

  function bump "Rise of an edge whose angle is amplitude*sin(pi*s)^2, per unit length, from s = 0"
    input Ratio s "Position within the bump, 0..1";
    input Ratio mean "Mean slope";
    input Real c[:] "Cosine coefficients of the slope, divided by 2 pi k";
    output Ratio rise;
  protected
    Real b0, b1, b2, x;
  algorithm
    // Clenshaw's recurrence for sum c[k] sin(2 pi k s)
    x := 2*cos(6.283185307179586*s);
    b1 := 0;
    b2 := 0;
    for k in size(c, 1):-1:1 loop
      b0 := c[k] + x*b1 - b2;
      b2 := b1;
      b1 := b0;
    end for;
    rise := mean*s + b1*sin(6.283185307179586*s);
  end bump;

  block Unevenness "Cubic B-splines at nodes evenly spaced; 0 from two nodes beyond each end"
    parameter Integer n = 3 "Number of nodes";
    parameter Position c[n] = zeros(n) "Coefficients; neutral 0";
    parameter Position low = 0 "First node";
    parameter Position high = 1 "Last node";
    input Position x "Position";
    output Position height;
    output Ratio slope "d height / dx";
  protected
    Boolean uneven "Any unevenness";
    Real node "Place among the nodes, 0 at the first";
    Position wide[n + 8] = cat(1, zeros(4), c, zeros(4));
    Position jump[n + 4] = {wide[i] - 4*wide[i + 1] + 6*wide[i + 2] - 4*wide[i + 3] + wide[i + 4] for i in 1:n + 4} "Of the third derivative, at each node from the second ahead of the first on";
  equation
    uneven = noEvent(sum(abs(c[i]) for i in 1:n) > 0);
    node = noEvent(min(max((n - 1)*(x - low)/(high - low), -2), n + 1));
    height = noEvent(if uneven then sum(jump[i]*max(node - i + 3, 0)^3 for i in 1:n + 4)/6 else 0);
    slope = noEvent(if uneven then sum(jump[i]*max(node - i + 3, 0)^2 for i in 1:n + 4)*(n - 1)/(2*(high - low)) else 0);
  end Unevenness;

  block Workpiece "Edge z_w(x) of the workpiece, relative to the stand-off"
    parameter EdgeShape shape = EdgeShape.straight "Edge profile";
    parameter Angle incline(min = -1.5, max = 1.5) = 0 "Slope angle of the inclined edge";
    parameter Angle extra_angle(min = -1.5, max = 1.5) = 0 "Workpiece mounted at this extra angle; neutral 0";
    parameter Real extra_bow(unit = "1/m", min = -10, max = 10) = 0 "Curvature of that extra mounting; neutral 0";
    parameter Position x_0 = 0.95 "Datum: z_w(x_0) = 0";
    parameter Position A[8](each min = -0.1, each max = 0.1) = {0, 0, 0, 0, 0, 0, 0, 0} "Surface finish, amplitudes; neutral 0; medium finish {0.2, 0.08, 0.03, 0, ...} mm [A]";
    parameter Position lambda[8](each min = 1e-4, each max = 100) = {0.060, 0.027, 0.013, 0.1, 0.1, 0.1, 0.1, 0.1} "Surface finish, wavelengths; the first three [A]";
    parameter Angle phi[8](each min = -10, each max = 10) = {0.3, 1.1, 2.0, 0, 0, 0, 0, 0} "Surface finish, phases; the first three [A]";
    parameter Position rise[61](each min = -0.1, each max = 0.1) = zeros(61) "Unevenness, coefficients of cubic B-splines at nodes evenly spaced from x_low to x_high; neutral 0";
    parameter Position rise_fine[121](each min = -0.1, each max = 0.1) = zeros(121) "The same at nodes half as far apart; neutral 0";
    parameter Position x_low(min = -10, max = 10) = 0.4 "First node of rise and rise_fine";
    parameter Position x_high(min = -10, max = 10) = 1.0 "Last node of rise and rise_fine";
    input Position x "Position along the x axis";
    input Position profile_at "Own profile: position about which it is expanded";
    input Position profile_height "Own profile: z_w at profile_at";
    input Ratio profile_slope "Own profile: slope at profile_at";
    input Real profile_curvature(unit = "1/m") "Own profile: second derivative at profile_at";
    output Position height "z_w";
    output Ratio slope "d z_w / dx";
  protected
    constant Real pi = 3.141592653589793;
    constant Ratio rise_mean = 0.5281790468634897 "mean of tan(50 deg sin^2)";
    constant Real rise_c[17] = {-9.2067333862646275e-02, 5.1457933093609805e-03, -8.8846531639971053e-04, 1.1571778609130270e-04, -1.9984557470923936e-05, 3.1944419080708004e-06, -5.6035756983612813e-07, 9.6832991927037695e-08, -1.7334778208216939e-08, 3.1083691031805854e-09, -5.6634680184172490e-10, 1.0371034914713043e-10, -1.9158700363434505e-11, 3.5568005875569990e-12, -6.6406377022582335e-13, 1.2449892726505681e-13, -2.3436304328503938e-14} "its cosine coefficients / (2 pi k)";
    constant Ratio dip_mean = -0.08782564314072659 "mean of tan(-10 deg sin^2)";
    constant Real dip_c[8] = {1.4022526617908586e-02, -2.6850468486211090e-05, 3.0404902901525346e-06, -1.7260308597737895e-08, 1.4391041359498592e-09, -1.2625943955454048e-11, 8.2946695360982402e-13, -9.5917034616943022e-15};
    Boolean rough "Any surface finish";
    Unevenness coarse(n = 61, c = rise, low = x_low, high = x_high);
    Unevenness fine(n = 121, c = rise_fine, low = x_low, high = x_high);
    Ratio s_rise "Position within the 50 deg bump, 0..1";
    Ratio s_dip "Position within the -10 deg bump, 0..1";
    Position h_shape, d;
    Ratio t_shape, t_finish;
    Position h_finish;
  equation
    rough = noEvent(sum(abs(A[i]) for i in 1:8) > 0);
    s_rise = noEvent(min(max((0.78 - x)/0.16, 0), 1));
    s_dip = noEvent(min(max((0.52 - x)/0.10, 0), 1));
    h_shape = noEvent(if shape == EdgeShape.curved then
        -(if s_rise <= 0 then 0 elseif s_rise >= 1 then 0.16*rise_mean else 0.16*bump(s_rise, rise_mean, rise_c))
        - (if s_dip <= 0 then 0 elseif s_dip >= 1 then 0.10*dip_mean else 0.10*bump(s_dip, dip_mean, dip_c))
      elseif shape == EdgeShape.inclined then tan(incline)*(x - x_0) else 0);
    t_shape = noEvent(if shape == EdgeShape.curved then
        (if s_rise > 0 and s_rise < 1 then tan(50*pi/180*sin(pi*s_rise)^2)
         elseif s_dip > 0 and s_dip < 1 then tan(-10*pi/180*sin(pi*s_dip)^2) else 0)
      elseif shape == EdgeShape.inclined then tan(incline) else 0);
    h_finish = noEvent(if rough then sum(A[i]*sin(2*pi*x/lambda[i] + phi[i]) for i in 1:8) else 0);
    t_finish = noEvent(if rough then sum(A[i]*2*pi/lambda[i]*cos(2*pi*x/lambda[i] + phi[i]) for i in 1:8) else 0);
    coarse.x = x;
    fine.x = x;
    d = x - profile_at;
    height = h_shape + h_finish + coarse.height + fine.height + (tan(extra_angle) + extra_bow*(x - x_0)/2)*(x - x_0) + profile_height + d*(profile_slope + d*profile_curvature/2);
    slope = t_shape + t_finish + coarse.slope + fine.slope + tan(extra_angle) + extra_bow*(x - x_0) + profile_slope + d*profile_curvature;
  end Workpiece;

  block Contact "Springy contact between the bearing on the end effector and the edge (Eq. 3-8, 3-9, 4-3, 4-4)"
    parameter Real K_c(unit = "N/m", min = 0, max = 1e8) = 1e4 "Stiffness; [D] from the poles and zero of Fig. 5.7";
    parameter Real C_c(unit = "N.s/m", min = 0, max = 1e5) = 30 "Damping; [D] from the poles and zero of Fig. 5.7";
    parameter Position z_0(min = -10, max = 10) = 0.040 "Stand-off: contact begins at z = z_0 + z_w";
    parameter Real hardening(unit = "1/m", min = -1e3, max = 1e5) = 0 "Relative growth of the stiffness with deflection; neutral 0";
    parameter Ratio hardening_exponent(min = 0.1, max = 5) = 1 "That growth goes as deflection to this power; the size stays that at 1 mm";
    parameter Ratio mu(min = 0, max = 10) = 0 "Drag of the bearing: f_t = mu f_n sgn v_t; neutral 0";
    parameter Velocity v_drag(min = 1e-5, max = 1) = 2e-3 "Speed over which the drag changes sign";
    parameter Ratio drag_rise(min = 0, max = 10) = 0 "Further share of mu at low speed, gone at ten times v_drag; neutral 0";
    parameter Boolean present = true "false: no workpiece";
    input Position z;
    input Velocity v_x;
    input Velocity v_z;
    input Position height "z_w at the present x";
    input Ratio slope "tan(theta)";
    output Force f_n "Normal force, > 0 presses into the workpiece";
    output Force f_t "Tangential force of the robot on the workpiece";
    output Force f_x "Contact force of the robot on the workpiece, x";
    output Force f_z "Contact force of the robot on the workpiece, z";
    output Velocity v_t "Tangential speed";
    output Velocity v_n "Normal speed";
    Position delta "Deflection, > 0 in contact";
    Boolean touching "In contact";
  protected
    Velocity delta_dot;
    Ratio c "cos(theta)", si "sin(theta)";
    Force spring, raw;
    Boolean pressing;
  equation
    c = 1/sqrt(1 + slope^2);
    si = slope*c;
    delta = if present then (z - z_0 - height)*c else -1;
    delta_dot = (v_z - slope*v_x)*c;
    touching = delta > 0;
    spring = K_c*delta*(1 + noEvent(if hardening_exponent == 1 then hardening*delta else hardening*1e-3*(max(delta, 0)/1e-3 + 1e-12)^hardening_exponent));
    raw = spring + C_c*delta_dot;
    pressing = (if touching then raw else -1) > 0;
    f_n = if touching and pressing then raw else 0;
    v_t = v_x*c + v_z*si;
    v_n = -v_x*si + v_z*c;
    f_t = if mu > 0 then mu*f_n*tanh(v_t/v_drag)*(1 + drag_rise*exp(-abs(v_t)/(10*v_drag))) else 0;
    f_x = -f_n*si + f_t*c;
    f_z = f_n*c + f_t*si;
  end Contact;

  model Gantry "Two valves, two cylinders, one workpiece"
    Valve valve_x(K = 186, u_0 = 0.635, tau = 0.30, f_max = 443, direction = -1, s_low = axis_x.s_low, s_high = axis_x.s_high);
    Valve valve_z(K = 100, u_0 = 0.735, tau = 0.15, f_max = 156, direction = 1, s_low = axis_z.s_low, s_high = axis_z.s_high);
    Cylinder axis_x(m = 7.3, C = 74, F_w = 5, s_high = 1.0, s_start = 0.95, friction(F_s = 25, F_d = 11));
    Cylinder axis_z(m = 2.25, C = 40, F_w = 5, s_high = 0.101, s_start = 0, friction(F_s = 20, F_d = 15));
    Workpiece workpiece;
    Contact contact;
    parameter Mass coupling(min = -100, max = 100) = 0 "Force on z per x acceleration; neutral 0";
    parameter Force coupling_limit(min = 0, max = 1e4) = 0 "Level at which that force saturates; 0: never";
    input Voltage u_x(start = 0) "Command of the x valve, 0..5; pushes to -x";
    input Voltage u_z(start = 0) "Command of the z valve, 0..5; pushes to +z";
    input Boolean clamp_x(start = false) "x carriage clamped";
    input Boolean clamp_z(start = false) "z carriage clamped";
    input Force f_manual_x(start = 0) "Force target set by hand through the other port of the x valve";
    input Force f_manual_z(start = 0) "Force target set by hand through the other port of the z valve";
    input Position profile_at(start = 0) "Own profile: position about which it is expanded";
    input Position profile_height(start = 0) "Own profile: height there, added to the shape's";
    input Ratio profile_slope(start = 0) "Own profile: slope there";
    input Real profile_curvature(start = 0, unit = "1/m") "Own profile: second derivative there";
    output Position x "x piston position, 0..1";
    output Position z "z piston position, 0..0.101";
    output Velocity v_x "x piston speed, dx/dt; tracking runs towards -x";
    output Velocity v_z "z piston speed, dz/dt; > 0 towards the workpiece";
    output Force f_x "Contact force of the robot on the workpiece, x";
    output Force f_z "Contact force of the robot on the workpiece, z";
    output Force f_ax "Actuator force, x";
    output Force f_az "Actuator force, z";
    output Force f_n "Normal contact force, > 0 presses into the workpiece";
    output Velocity v_t "Tangential speed";
    output Angle theta "Slope angle of the edge";
  equation
    valve_x.u = u_x;
    valve_z.u = u_z;
    valve_x.s = axis_x.s;
    valve_z.s = axis_z.s;
    valve_x.f_manual = f_manual_x;
    valve_z.f_manual = f_manual_z;
    axis_x.f_a = valve_x.f_a;
    axis_z.f_a = valve_z.f_a;
    axis_x.f_c = contact.f_x;
    axis_z.f_c = contact.f_z;
    axis_x.f_load = contact.f_n;
    axis_z.f_load = contact.f_n;
    axis_x.f_couple = 0;
    axis_z.f_couple = noEvent(if coupling_limit > 0 then coupling_limit*tanh(coupling*axis_x.a/(if coupling_limit > 0 then coupling_limit else 1)) else coupling*axis_x.a);
    axis_x.clamp = clamp_x;
    axis_z.clamp = clamp_z;
    workpiece.x = axis_x.s;
    workpiece.profile_at = profile_at;
    workpiece.profile_height = profile_height;
    workpiece.profile_slope = profile_slope;
    workpiece.profile_curvature = profile_curvature;
    contact.z = axis_z.s;
    contact.v_x = axis_x.v;
    contact.v_z = axis_z.v;
    contact.height = workpiece.height;
    contact.slope = workpiece.slope;
    x = axis_x.s;
    z = axis_z.s;
    v_x = axis_x.v;
    v_z = axis_z.v;
    f_x = contact.f_x;
    f_z = contact.f_z;
    f_ax = valve_x.f_a;
    f_az = valve_z.f_a;
    f_n = contact.f_n;
    v_t = contact.v_t;
    theta = atan(workpiece.slope);
    annotation(experiment(StopTime = 45));
  end Gantry;

  block Edge "Workpiece and contact as one block: positions and speeds in, contact force out"
    Workpiece workpiece;
    Contact contact;
    input Position x(start = 0.95) "x piston position";
    input Position z(start = 0) "z piston position";
    input Velocity v_x(start = 0);
    input Velocity v_z(start = 0);
    input Position profile_at(start = 0) "Own profile: position about which it is expanded";
    input Position profile_height(start = 0) "Own profile: height there";
    input Ratio profile_slope(start = 0) "Own profile: slope there";
    input Real profile_curvature(start = 0, unit = "1/m") "Own profile: second derivative there";
    output Force f_x "Contact force of the robot on the workpiece, x";
    output Force f_z "Contact force of the robot on the workpiece, z";
    output Force f_n "Normal force, > 0 presses into the workpiece";
  equation
    workpiece.x = x;
    workpiece.profile_at = profile_at;
    workpiece.profile_height = profile_height;
    workpiece.profile_slope = profile_slope;
    workpiece.profile_curvature = profile_curvature;
    contact.z = z;
    contact.v_x = v_x;
    contact.v_z = v_z;
    contact.height = workpiece.height;
    contact.slope = workpiece.slope;
    f_x = contact.f_x;
    f_z = contact.f_z;
    f_n = contact.f_n;
  end Edge;

  package Validation "One model per component whose answer is known in closed form: `error` stays below `tolerance`"
    model ValveStep "f_a = f_inf (1 - exp(-t/tau))"
      Valve valve;
      parameter Real tolerance = 1e-8;
      output Force error;
    equation
      valve.u = 1.535;
      valve.s = 0.5;
      valve.f_manual = 0;
      error = valve.f_a - 80*(1 - exp(-time/0.15));
    end ValveStep;

    model ValveDelay "A command that rises evenly arrives delay_time later"
      Valve valve(delay_time = 0.0123, tau = 0.05);
      parameter Real tolerance = 1e-7;
      output Force error;
    protected
      Real t_late;
    equation
      valve.u = 0.735 + 0.5*time;
      valve.s = 0.5;
      valve.f_manual = 0;
      t_late = if time > 0.0123 then time - 0.0123 else 0;
      error = valve.f_a - 50*(t_late - 0.05*(1 - exp(-t_late/0.05)));
    end ValveDelay;

    model ValvePlay "A rising command passes the play less its half-width; a small fall behind it does not pass"
      Valve valve(play = 0.1, tau = 1e-3);
      parameter Real tolerance = 1e-9;
      output Force error;
    equation
      valve.u = if time < 0.5 then 1.735 else 1.635;
      valve.s = 0.5;
      valve.f_manual = 0;
      error = if time < 0.05 then 0 else valve.f_a - 90;
    end ValvePlay;

    model SupplyDroop "At a constant force the supply falls to 1 - droop |f_a| / f_max with droop_time"
      Valve valve(droop = 0.2, droop_time = 0.3, K = 0);
      parameter Real tolerance = 1e-10;
      output Ratio error;
    protected
      parameter Ratio share = 39/156;
    equation
      valve.u = 0;
      valve.s = 0.5;
      valve.f_manual = 39;
      // supply for f_a = 39 (1 - exp(-t/0.15)), solved by hand
      error = valve.supply - (1 - 0.2*share*(1 - (0.3*exp(-time/0.3) - 0.15*exp(-time/0.15))/0.15));
    end SupplyDroop;

    model ViscousAxis "Without Coulomb friction v = f/C (1 - exp(-C t/m))"
      Cylinder axis(friction(law = FrictionLaw.none), s_high = 10);
      parameter Real tolerance = 1e-8;
      output Velocity error;
    equation
      axis.f_a = 25;
      axis.f_c = 0;
      axis.f_couple = 0;
      axis.f_load = 0;
      axis.clamp = false;
      error = axis.v - 0.5*(1 - exp(-40*time/2.25));
    end ViscousAxis;

    model StickSlip "Break-away when the rising force reaches F_s, at rest before; the event's time is known"
      Cylinder axis(s_high = 10, s_start = 1, F_w = 0);
      parameter Real tolerance = 1e-8;
      discrete Time t_slip(start = 0, fixed = true) "When the piston broke away";
      output Real error;
    equation
      axis.f_a = 50*time;
      axis.f_c = 0;
      axis.f_couple = 0;
      axis.f_load = 0;
      axis.clamp = false;
      when axis.f_a > 20 then
        t_slip = time;
      end when;
      error = if time < 0.4 then axis.v elseif time < 0.41 then
          axis.v - 50/40*((time - 0.4) - 2.25/40*(1 - exp(-40*(time - 0.4)/2.25))) else t_slip - 0.4;
    end StickSlip;

    model EndStop "Driven onto its stop the piston stays there at rest, and leaves it when pulled back"
      Cylinder axis(friction(law = FrictionLaw.none), s_high = 0.1, F_w = 0, C = 0);
      parameter Real tolerance = 1e-9;
      output Position error;
    protected
      parameter Time t_hit = sqrt(2*0.1*2.25/20) "Constant acceleration 20/2.25";
    equation
      axis.f_a = if time < 1 then 20 else -20;
      axis.f_c = 0;
      axis.f_couple = 0;
      axis.f_load = 0;
      axis.clamp = false;
      error = if time < t_hit then axis.s - 0.5*20/2.25*time^2 elseif time < 1 then axis.s - 0.1
        elseif time < 1 + t_hit then axis.s - 0.1 + 0.5*20/2.25*(time - 1)^2 else axis.s;
    end EndStop;

    model DahlBranch "From rest the DDFM gives F = beta (1 - 1/(1 + sigma s/beta))"
      Friction friction(law = FrictionLaw.ddfm);
      parameter Real tolerance = 1e-8;
      output Force error;
    equation
      friction.v = 0.001;
      friction.s = 0.001*time;
      friction.f_net = 0;
      friction.f_load = 0;
      error = friction.F - 12*(1 - 1/(1 + 1e5*0.001*time/12));
    end DahlBranch;

    model LuGreSteady "After sliding for long at one speed LuGre gives its Stribeck curve"
      Friction friction(law = FrictionLaw.lugre);
      parameter Real tolerance = 1e-9;
      output Force error;
    equation
      friction.v = 0.02;
      friction.s = 0.02*time;
      friction.f_net = 0;
      friction.f_load = 0;
      error = if time < 0.5 then 0 else friction.F - (15 + 5*exp(-1));
    end LuGreSteady;

    model StribeckCurve "At a rising speed the stick band's friction decays from F_s to F_d"
      Friction friction(law = FrictionLaw.stribeck);
      parameter Real tolerance = 1e-10;
      output Force error;
    equation
      friction.v = 0.02 + 0.1*time;
      friction.s = 0.5;
      friction.f_net = 100;
      friction.f_load = 0;
      error = friction.F - (15 + 5*exp(-(0.01 + 0.1*time)/0.02));
    end StribeckCurve;

    model EvenIndentation "Pressed in evenly the contact gives K_c delta + C_c v from onset on"
      Edge edge;
      parameter Real tolerance = 1e-10;
      output Force error;
    equation
      edge.profile_at = 0;
      edge.profile_height = 0;
      edge.profile_slope = 0;
      edge.profile_curvature = 0;
      edge.x = 0.5;
      edge.z = 0.039 + 0.01*time;
      edge.v_x = 0;
      edge.v_z = 0.01;
      error = edge.f_n - (if time > 0.1 then 1e4*0.01*(time - 0.1) + 30*0.01 else 0);
    end EvenIndentation;

    model InclinedForce "On an incline f_n splits into -sin and cos of its angle; the drag lies along the edge"
      Edge edge(workpiece(shape = EdgeShape.inclined, incline = 0.3), contact(mu = 0.1, z_0 = 0));
      parameter Real tolerance = 1e-10;
      output Force error;
    protected
      Force f_n, f_t;
    equation
      edge.profile_at = 0;
      edge.profile_height = 0;
      edge.profile_slope = 0;
      edge.profile_curvature = 0;
      edge.x = 0.95;
      edge.z = 0.003/cos(0.3);
      edge.v_x = -0.06*cos(0.3);
      edge.v_z = -0.06*sin(0.3);
      f_n = 1e4*0.003;
      f_t = -0.1*f_n*tanh(0.06/2e-3);
      error = abs(edge.f_n - f_n) + abs(edge.f_x - (-f_n*sin(0.3) + f_t*cos(0.3))) + abs(edge.f_z - (f_n*cos(0.3) + f_t*sin(0.3)));
    end InclinedForce;

    model CurvedEdge "The height of the curved edge is the integral of its slope"
      Workpiece workpiece(shape = EdgeShape.curved, A = {2e-4, 8e-5, 3e-5, 0, 0, 0, 0, 0});
      parameter Real tolerance = 5e-9;
      output Position error;
    protected
      Position integral(start = 0, fixed = true);
      parameter Position at_start = 2e-4*sin(2*3.141592653589793*0.95/0.060 + 0.3) + 8e-5*sin(2*3.141592653589793*0.95/0.027 + 1.1) + 3e-5*sin(2*3.141592653589793*0.95/0.013 + 2.0);
    equation
      workpiece.x = 0.95 - 0.6*time;
      workpiece.profile_at = 0;
      workpiece.profile_height = 0;
      workpiece.profile_slope = 0;
      workpiece.profile_curvature = 0;
      der(integral) = -0.6*workpiece.slope;
      error = workpiece.height - integral - at_start;
    end CurvedEdge;

    model UnevenEdge "Coefficients that are squares give a parabola: sum of i^2 B(u - i) = u^2 + 1/3"
      Workpiece workpiece(rise = {1e-6*(i - 1)^2 for i in 1:61});
      Workpiece fine(rise_fine = {2.5e-7*(i - 1)^2 for i in 1:121}) "The same edge: its nodes are half as far apart";
      parameter Real tolerance = 1e-12;
      output Real error;
    protected
      Real u, w "Places among the nodes";
    equation
      workpiece.x = 0.95 - 0.15*time;
      workpiece.profile_at = 0;
      workpiece.profile_height = 0;
      workpiece.profile_slope = 0;
      workpiece.profile_curvature = 0;
      fine.x = workpiece.x;
      fine.profile_at = 0;
      fine.profile_height = 0;
      fine.profile_slope = 0;
      fine.profile_curvature = 0;
      u = (workpiece.x - 0.4)/0.01;
      w = 2*u;
      error = abs(workpiece.height - 1e-6*(u^2 + 1/3)) + abs(workpiece.slope - 2e-4*u) + abs(fine.height - 2.5e-7*(w^2 + 1/3)) + abs(fine.slope - 1e-4*w);
    end UnevenEdge;

    model FineTable "Nodes on a parabola give that parabola between them"
      Friction friction(position_fine = {((i - 11)/10)^2 for i in 1:21});
      parameter Real tolerance = 1e-12;
      output Force error;
    equation
      friction.v = 0.5;
      friction.s = 0.76*time;
      friction.f_net = 0;
      friction.f_load = 0;
      error = friction.F - 15*(1 + (2*friction.s - 1)^2);
    end FineTable;

    model FineNodes "Single nodes: the weights of cubic convolution; beyond its ends a table holds"
      Friction friction(position_fine = {if i == 1 then 0.3 elseif i == 6 or i == 16 then 1 elseif i == 21 then -0.2 else 0 for i in 1:21});
      parameter Real tolerance = 3e-12;
      output Force error;
    protected
      Real u "Place among the nodes";
    equation
      friction.v = 0.5;
      friction.s = 1.05 - 0.9*time;
      friction.f_net = 0;
      friction.f_load = 0;
      u = min(max(20*friction.s, 0), 20);
      error = friction.F - 15*(1 + 0.3*keys(u) + 0.9*keys(u + 1) + keys(u - 5) + keys(u - 15) - 0.2*keys(u - 20) - 0.6*keys(u - 21));
    end FineNodes;

    function keys "Weight of a node at this distance"
      input Real apart;
      output Real weight;
    protected
      Real wide "2 less the distance, or 0", close "1 less the distance, or 0";
    algorithm
      wide := max(2 - abs(apart), 0);
      close := max(1 - abs(apart), 0);
      weight := wide^2*(wide - 1)/2 + close^2*(1 - 2*close);
    end keys;

    model CoarseNodes "Straight between the nodes of a table; beyond its ends it holds"
      Friction friction(position_table = {if i == 1 then 0.5 elseif i == 4 then 1 elseif i == 11 then -0.5 else 0 for i in 1:11});
      parameter Real tolerance = 1e-12;
      output Force error;
    protected
      Real u "Place among the nodes";
    equation
      friction.v = 0.5;
      friction.s = 1.05 - 0.9*time;
      friction.f_net = 0;
      friction.f_load = 0;
      u = min(max(10*friction.s, 0), 10);
      error = friction.F - 15*(1 + 0.5*max(1 - u, 0) + max(1 - abs(u - 3), 0) - 0.5*max(u - 9, 0));
    end CoarseNodes;

    model EdgeNodes "Single coefficients of an edge: B-splines, and their slopes"
      Workpiece workpiece(rise = {if i == 1 or i == 20 or i == 45 then 1e-3 else 0 for i in 1:61});
      parameter Real tolerance = 1e-12;
      output Real error;
    protected
      Real u "Place among the nodes";
    equation
      workpiece.x = 1.05 - 0.6*time;
      workpiece.profile_at = 0;
      workpiece.profile_height = 0;
      workpiece.profile_slope = 0;
      workpiece.profile_curvature = 0;
      u = (workpiece.x - 0.4)/0.01;
      error = abs(workpiece.height - 1e-3*(spline(u) + spline(u - 19) + spline(u - 44)))
        + abs(workpiece.slope - 0.1*(spline_slope(u) + spline_slope(u - 19) + spline_slope(u - 44)));
    end EdgeNodes;

    function spline "Cubic B-spline about 0"
      input Real apart;
      output Real height;
    algorithm
      height := (max(2 - abs(apart), 0)^3 - 4*max(1 - abs(apart), 0)^3)/6;
    end spline;

    function spline_slope "Its derivative"
      input Real apart;
      output Real slope;
    algorithm
      slope := sign(apart)*(4*max(1 - abs(apart), 0)^2 - max(2 - abs(apart), 0)^2)/2;
    end spline_slope;
  end Validation;
  annotation(version = "0.1.0", versionDate = "2026-11-21",
    __FMU(author = "The PneuGantry developers", license = "MIT", copyright = "The PneuGantry developers"));
end PneuGantry;
