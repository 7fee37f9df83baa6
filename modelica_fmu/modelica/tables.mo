within Modelica.Blocks;
// Tables of the standard library in Modelica: there they are objects of a C library. Of these classes
// the ones below stand in the place of those of the same name. What they cannot do calls a function
// without a body, which is refused when it is reached while compiling.

package Types
  record ExternalCombiTable1D "Columns of values over a rising first column"
    parameter String tableName;
    parameter String fileName;
    parameter Real table[:, :];
    parameter Integer columns[:];
    parameter Modelica.Blocks.Types.Smoothness smoothness;
    parameter Modelica.Blocks.Types.Extrapolation extrapolation=Modelica.Blocks.Types.Extrapolation.LastTwoPoints;
    parameter Boolean verboseRead=true;
    parameter String delimiter=",";
    parameter Integer nHeaderLines=0;
  end ExternalCombiTable1D;
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
          at := unsupportedExtrapolation(u);
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

    function unsupportedExtrapolation "A table without values beyond its ends"
      input Real u;
      output Real y;
      external "C";
    end unsupportedExtrapolation;

    function unsupportedSmoothness "Neither lines nor steps"
      input Real u;
      output Real y;
      external "C";
    end unsupportedSmoothness;
  end Internal;
end Tables;
