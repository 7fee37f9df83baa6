within Modelica.Blocks;
// Tables of the standard library in Modelica: there they are objects of a C library. The classes below
// stand in the place of those of the same name. What they cannot do calls a function without a body,
// which is refused when it is reached while compiling. How a table is read is decided while compiling.

package Types
  record ExternalCombiTable1D "Columns of values over a rising first column"
    parameter String tableName;
    parameter String fileName;
    parameter Real table[:, :];
    parameter Integer columns[:];
    constant Modelica.Blocks.Types.Smoothness smoothness;
    constant Modelica.Blocks.Types.Extrapolation extrapolation=Modelica.Blocks.Types.Extrapolation.LastTwoPoints;
    parameter Boolean verboseRead=true;
    parameter String delimiter=",";
    parameter Integer nHeaderLines=0;
  end ExternalCombiTable1D;

  record ExternalCombiTable2D "Values over a first column (u1) and a first row (u2), both rising"
    parameter String tableName;
    parameter String fileName;
    parameter Real table[:, :];
    constant Modelica.Blocks.Types.Smoothness smoothness;
    constant Modelica.Blocks.Types.Extrapolation extrapolation=Modelica.Blocks.Types.Extrapolation.LastTwoPoints;
    parameter Boolean verboseRead=true;
    parameter String delimiter=",";
    parameter Integer nHeaderLines=0;
  end ExternalCombiTable2D;

  record ExternalCombiTimeTable "Columns of values over a first column of times; equal times: a jump"
    parameter String tableName;
    parameter String fileName;
    parameter Real table[:, :];
    parameter Real startTime "Before it the values are 0";
    parameter Integer columns[:];
    constant Modelica.Blocks.Types.Smoothness smoothness;
    constant Modelica.Blocks.Types.Extrapolation extrapolation;
    parameter Real shiftTime=0.0 "Added to the times of the table";
    constant Modelica.Blocks.Types.TimeEvents timeEvents=Modelica.Blocks.Types.TimeEvents.Always;
    parameter Boolean verboseRead=true;
    parameter String delimiter=",";
    parameter Integer nHeaderLines=0;
  end ExternalCombiTimeTable;
end Types;

package Tables
  package Internal
    function getTable1DValue "Interpolates between the rows, by lines or by steps"
      input Modelica.Blocks.Types.ExternalCombiTable1D tableID;
      input Integer icol;
      input Real u;
      output Real y;
    protected
      Integer n=size(tableID.table, 1);
      Integer c=tableID.columns[icol];
      Real at=u "where the table is read";
    algorithm
      if n == 1 then
        y := tableID.table[1, c];
      else
        if tableID.extrapolation == Modelica.Blocks.Types.Extrapolation.HoldLastPoint then
          at := min(max(u, tableID.table[1, 1]), tableID.table[n, 1]);
        elseif tableID.extrapolation == Modelica.Blocks.Types.Extrapolation.Periodic then
          at := u - floor((u - tableID.table[1, 1])/(tableID.table[n, 1] - tableID.table[1, 1]))
            *(tableID.table[n, 1] - tableID.table[1, 1]);
        elseif tableID.extrapolation == Modelica.Blocks.Types.Extrapolation.NoExtrapolation then
          at := confined(u, tableID.table[1, 1], tableID.table[n, 1]);
        end if;
        if tableID.smoothness == Modelica.Blocks.Types.Smoothness.ConstantSegments then
          y := tableID.table[1, c];
          for i in 2:n loop
            y := if at >= tableID.table[i, 1] then tableID.table[i, c] else y;
          end for;
        elseif tableID.smoothness == Modelica.Blocks.Types.Smoothness.LinearSegments then
          y := line(tableID.table[1, 1], tableID.table[1, c], tableID.table[2, 1], tableID.table[2, c], at);
          for i in 2:n - 1 loop
            if tableID.table[i + 1, 1] > tableID.table[i, 1] then
              y := if at >= tableID.table[i, 1] then line(tableID.table[i, 1], tableID.table[i, c],
                tableID.table[i + 1, 1], tableID.table[i + 1, c], at) else y;
            end if;
          end for;
        else
          y := unsupportedSmoothness(u);
        end if;
      end if;
    end getTable1DValue;

    function getTable1DValueNoDer
      extends getTable1DValue;
    end getTable1DValueNoDer;

    function getTable1DValueNoDer2
      extends getTable1DValue;
    end getTable1DValueNoDer2;

    function getTable1DAbscissaUmin
      input Modelica.Blocks.Types.ExternalCombiTable1D tableID;
      output Real uMin;
    algorithm
      uMin := tableID.table[1, 1];
    end getTable1DAbscissaUmin;

    function getTable1DAbscissaUmax
      input Modelica.Blocks.Types.ExternalCombiTable1D tableID;
      output Real uMax;
    algorithm
      uMax := tableID.table[size(tableID.table, 1), 1];
    end getTable1DAbscissaUmax;

    function line "Through two points"
      input Real x1;
      input Real y1;
      input Real x2;
      input Real y2;
      input Real x;
      output Real y;
    algorithm
      y := y1 + (y2 - y1)/(x2 - x1)*(x - x1);
    end line;

    function confined "No number outside of [low, high]: it stops the run"
      input Real u;
      input Real low;
      input Real high;
      output Real y;
    algorithm
      y := if u >= low and u <= high then u else sqrt(-1);
    end confined;

    function unsupportedSmoothness "Neither lines nor steps"
      input Real u;
      output Real y;
      external "C";
    end unsupportedSmoothness;

    function getTable2DValue "Interpolates between the grid's points, by a bilinear function or steps"
      input Modelica.Blocks.Types.ExternalCombiTable2D tableID;
      input Real u1;
      input Real u2;
      output Real y;
    protected
      Integer n=size(tableID.table, 1);
      Integer m=size(tableID.table, 2);
      Real at1=inside(u1, tableID.table[min(2, n), 1], tableID.table[n, 1], tableID.extrapolation);
      Real at2=inside(u2, tableID.table[1, min(2, m)], tableID.table[1, m], tableID.extrapolation);
      Real row[m] "the values at u1, over the first row";
    algorithm
      for j in 2:m loop
        row[j] := between(tableID.table[2:n, 1], tableID.table[2:n, j], at1, tableID.smoothness);
      end for;
      y := between(tableID.table[1, 2:m], row[2:m], at2, tableID.smoothness);
    end getTable2DValue;

    function getTable2DValueNoDer
      extends getTable2DValue;
    end getTable2DValueNoDer;

    function getTable2DValueNoDer2
      extends getTable2DValue;
    end getTable2DValueNoDer2;

    function getTable2DAbscissaUmin
      input Modelica.Blocks.Types.ExternalCombiTable2D tableID;
      output Real uMin[2];
    algorithm
      uMin := {tableID.table[2, 1], tableID.table[1, 2]};
    end getTable2DAbscissaUmin;

    function getTable2DAbscissaUmax
      input Modelica.Blocks.Types.ExternalCombiTable2D tableID;
      output Real uMax[2];
    algorithm
      uMax := {tableID.table[size(tableID.table, 1), 1], tableID.table[1, size(tableID.table, 2)]};
    end getTable2DAbscissaUmax;

    function inside "Where a table is read for u, by what is done beyond its ends"
      input Real u;
      input Real low;
      input Real high;
      input Modelica.Blocks.Types.Extrapolation extrapolation;
      output Real at;
    algorithm
      if extrapolation == Modelica.Blocks.Types.Extrapolation.HoldLastPoint then
        at := min(max(u, low), high);
      elseif extrapolation == Modelica.Blocks.Types.Extrapolation.Periodic then
        at := u - floor((u - low)/(high - low))*(high - low);
      elseif extrapolation == Modelica.Blocks.Types.Extrapolation.NoExtrapolation then
        at := confined(u, low, high);
      else
        at := u;
      end if;
    end inside;

    function between "Through points over rising x, by lines or by steps"
      input Real x[:];
      input Real y[:];
      input Real at;
      input Modelica.Blocks.Types.Smoothness smoothness;
      output Real value;
    protected
      Integer n=size(x, 1);
    algorithm
      value := y[1];
      if smoothness == Modelica.Blocks.Types.Smoothness.ConstantSegments then
        for i in 2:n loop
          value := if at >= x[i] then y[i] else value;
        end for;
      elseif smoothness == Modelica.Blocks.Types.Smoothness.LinearSegments then
        for i in 1:n - 1 loop
          value := if i == 1 or at >= x[i] then line(x[i], y[i], x[i + 1], y[i + 1], at) else value;
        end for;
      else
        value := unsupportedSmoothness(at);
      end if;
    end between;

    function getTimeTableTmin
      input Modelica.Blocks.Types.ExternalCombiTimeTable tableID;
      output Real timeMin;
    algorithm
      timeMin := tableID.table[1, 1];
    end getTimeTableTmin;

    function getTimeTableTmax
      input Modelica.Blocks.Types.ExternalCombiTimeTable tableID;
      output Real timeMax;
    algorithm
      timeMax := tableID.table[size(tableID.table, 1), 1];
    end getTimeTableTmax;

    function getNextTimeEvent "The first instant after timeIn at which another piece of the table begins"
      input Modelica.Blocks.Types.ExternalCombiTimeTable tableID;
      input Real timeIn;
      output Real nextTimeEvent "1e60: none";
    protected
      Integer n=size(tableID.table, 1);
      Real first=tableID.table[1, 1] + tableID.shiftTime;
      Real period=tableID.table[n, 1] - tableID.table[1, 1];
      Real after=timeIn + 1e-12*(1 + abs(timeIn)) "instants up to here have been";
      Real round=0 "start of the current period, beside the first";
    algorithm
      nextTimeEvent := 1e60;
      if tableID.timeEvents <> Modelica.Blocks.Types.TimeEvents.NoTimeEvents and n > 1 then
        if tableID.extrapolation == Modelica.Blocks.Types.Extrapolation.Periodic then
          round := floor((after - first)/period)*period;
          nextTimeEvent := first + round + period;
        end if;
        for i in n:-1:1 loop
          if tableID.timeEvents == Modelica.Blocks.Types.TimeEvents.Always or jump(tableID, i) then
            nextTimeEvent := if tableID.table[i, 1] + tableID.shiftTime + round > after then
              tableID.table[i, 1] + tableID.shiftTime + round else nextTimeEvent;
          end if;
        end for;
      end if;
      nextTimeEvent := if tableID.startTime > after then tableID.startTime else nextTimeEvent;
    end getNextTimeEvent;

    function jump "Whether row i has the time of the row before or after it, or ends the table"
      input Modelica.Blocks.Types.ExternalCombiTimeTable tableID;
      input Integer i;
      output Boolean yes;
    protected
      Integer n=size(tableID.table, 1);
    algorithm
      yes := i == 1 or i == n;
      if i < n then
        yes := yes or tableID.table[min(i + 1, n), 1] <= tableID.table[i, 1];
      end if;
    end jump;

    function getTimeTableValue "Interpolates between rows, by lines or by steps; 0 before startTime"
      input Modelica.Blocks.Types.ExternalCombiTimeTable tableID;
      input Integer icol;
      input Real timeIn;
      input Real nextTimeEvent "a row that begins with it, or later, is not used yet";
      input Real pre_nextTimeEvent;
      output Real y;
    protected
      Integer n=size(tableID.table, 1);
      Integer c=tableID.columns[icol];
      Real first=tableID.table[1, 1];
      Real period=tableID.table[n, 1] - first;
      Real at=timeIn - tableID.shiftTime;
      Real until=nextTimeEvent - tableID.shiftTime;
      Real round=0;
    algorithm
      if tableID.extrapolation == Modelica.Blocks.Types.Extrapolation.Periodic and n > 1 then
        round := if nextTimeEvent < 1e59 then ceil((until - first)/period - 1e-9) - 1
          else floor((at - first)/period);
        at := at - round*period;
        until := until - round*period;
      elseif tableID.extrapolation == Modelica.Blocks.Types.Extrapolation.HoldLastPoint then
        at := min(max(at, first), tableID.table[n, 1]);
      elseif tableID.extrapolation == Modelica.Blocks.Types.Extrapolation.NoExtrapolation then
        at := confined(at, first, tableID.table[n, 1]);
      end if;
      until := until - 1e-12*(1 + abs(nextTimeEvent));
      y := tableID.table[1, c];
      if tableID.smoothness == Modelica.Blocks.Types.Smoothness.ConstantSegments then
        for i in 2:n loop
          y := if at >= tableID.table[i, 1] and until > tableID.table[i, 1] then tableID.table[i, c] else y;
        end for;
      elseif tableID.smoothness == Modelica.Blocks.Types.Smoothness.LinearSegments then
        for i in 1:n - 1 loop
          if tableID.table[i + 1, 1] > tableID.table[i, 1] then
            y := if i == 1 or at >= tableID.table[i, 1] and until > tableID.table[i, 1] then
              line(tableID.table[i, 1], tableID.table[i, c], tableID.table[i + 1, 1],
                tableID.table[i + 1, c], at) else y;
          end if;
        end for;
        if n > 1 and tableID.extrapolation == Modelica.Blocks.Types.Extrapolation.HoldLastPoint then
          y := if at >= tableID.table[n, 1] and until > tableID.table[n, 1] then tableID.table[n, c] else y;
        end if;
      else
        y := unsupportedSmoothness(timeIn);
      end if;
      y := if nextTimeEvent > tableID.startTime and timeIn >= tableID.startTime then y else 0;
    end getTimeTableValue;

    function getTimeTableValueNoDer
      extends getTimeTableValue;
    end getTimeTableValueNoDer;

    function getTimeTableValueNoDer2
      extends getTimeTableValue;
    end getTimeTableValueNoDer2;
  end Internal;
end Tables;
