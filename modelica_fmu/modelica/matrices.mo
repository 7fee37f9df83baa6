within Modelica;
// Linear equations of the standard library in Modelica: there LAPACK solves them. The functions below stand
// in the place of those of the same name. They eliminate with the largest pivot of each column.

package Math
  package Matrices
    function solve "A*x = b for one right side"
      input Real A[:, size(A, 1)];
      input Real b[size(A, 1)];
      output Real x[size(b, 1)];
    protected
      Real X[size(b, 1), 1];
    algorithm
      X := solve2(A, matrix(b));
      x := X[:, 1];
    end solve;

    function solve2 "A*X = B"
      input Real A[:, size(A, 1)];
      input Real B[size(A, 1), :];
      output Real X[size(B, 1), size(B, 2)];
    protected
      Integer n=size(A, 1);
      Integer m=size(B, 2);
      Real E[n, n + m];
      Real sign;
    algorithm
      (E, sign) := eliminated(A, B);
      for j in 1:m loop
        for i in n:-1:1 loop
          X[i, j] := E[i, n + j];
          for k in i + 1:n loop
            X[i, j] := X[i, j] - E[i, k]*X[k, j];
          end for;
          X[i, j] := X[i, j]/E[i, i];
        end for;
      end for;
    end solve2;

    function inv
      input Real A[:, size(A, 1)];
      output Real invA[size(A, 1), size(A, 2)];
    algorithm
      invA := solve2(A, identity(size(A, 1)));
    end inv;

    function det
      input Real A[:, size(A, 1)];
      output Real result;
    protected
      Integer n=size(A, 1);
      Real E[n, n];
    algorithm
      (E, result) := eliminated(A, zeros(n, 0));
      for i in 1:n loop
        result := result*E[i, i];
      end for;
    end det;

    function eliminated "[A, B] with zeros below its diagonal; sign: -1 for each exchange of rows"
      input Real A[:, size(A, 1)];
      input Real B[size(A, 1), :];
      output Real E[size(A, 1), size(A, 1) + size(B, 2)];
      output Real sign;
    protected
      Integer n=size(A, 1);
      Real upper;
      Real factor;
      Boolean larger;
    algorithm
      E := cat(2, A, B);
      sign := 1;
      for k in 1:n loop
        for i in k + 1:n loop
          larger := abs(E[i, k]) > abs(E[k, k]);
          sign := if larger then -sign else sign;
          for j in k:size(E, 2) loop
            upper := E[k, j];
            E[k, j] := if larger then E[i, j] else upper;
            E[i, j] := if larger then upper else E[i, j];
          end for;
        end for;
        for i in k + 1:n loop
          factor := E[i, k]/E[k, k];
          for j in k:size(E, 2) loop
            E[i, j] := E[i, j] - factor*E[k, j];
          end for;
        end for;
      end for;
    end eliminated;
  end Matrices;
end Math;
